/* What every FMI 2 unit of the tests does alike. Before it stands: N values v (states, derivatives, inputs, parameters, outputs),
   NX states and NU inputs, a Unit with v, t, continuous and say, and what it starts from and its rates: start(m), rates(m). */
#define S(name) FMI2_Export fmi2Status fmi2##name
#define M Unit *m = (Unit *)c
typedef fmi2Component C;

static void walk(Unit *m, double dt) { /* Runge-Kutta of order 4 */
    double *v = m->v, x[NX], k[4][NX], h[3] = {dt / 2, dt / 2, dt};
    memcpy(x, v, sizeof x);
    for (int s = 0; s < 4; s++) {
        rates(m);
        memcpy(k[s], v + NX, sizeof x);
        for (int i = 0; i < NX && s < 3; i++) v[i] = x[i] + h[s] * k[s][i];
    }
    for (int i = 0; i < NX; i++) v[i] = x[i] + dt / 6 * (k[0][i] + 2 * k[1][i] + 2 * k[2][i] + k[3][i]);
}

FMI2_Export const char *fmi2GetTypesPlatform(void) { return "default"; }
FMI2_Export const char *fmi2GetVersion(void) { return "2.0"; }
FMI2_Export C fmi2Instantiate(fmi2String n, fmi2Type k, fmi2String g, fmi2String r, const fmi2CallbackFunctions *f, fmi2Boolean a, fmi2Boolean b) {
    Unit *m = calloc(1, sizeof(Unit));
    m->say = f->logger; start(m); return m;
}
FMI2_Export void fmi2FreeInstance(C c) { free(c); }
S(SetDebugLogging)(C c, fmi2Boolean on, size_t n, const fmi2String s[]) { return fmi2OK; }
S(SetupExperiment)(C c, fmi2Boolean d, double e, double t, fmi2Boolean f, double g) { M; m->t = t; return fmi2OK; }
S(EnterInitializationMode)(C c) { return fmi2OK; }
S(ExitInitializationMode)(C c) { return fmi2OK; }
S(Terminate)(C c) { return fmi2OK; }
S(Reset)(C c) { start(c); return fmi2OK; }
S(GetReal)(C c, const fmi2ValueReference r[], size_t n, double v[]) {
    M; rates(m); for (size_t i = 0; i < n; i++) v[i] = m->v[r[i]]; return fmi2OK;
}
S(SetReal)(C c, const fmi2ValueReference r[], size_t n, const double v[]) {
    M;
    for (size_t i = 0; i < n; i++) {
        if (m->continuous && (r[i] < 2 * NX || r[i] >= 2 * NX + NU)) return fmi2Error; /* only inputs in continuous time */
        m->v[r[i]] = v[i];
    }
    return fmi2OK;
}
S(GetFMUstate)(C c, fmi2FMUstate *s) { *s = memcpy(malloc(sizeof(Unit)), c, sizeof(Unit)); return fmi2OK; }
S(SetFMUstate)(C c, fmi2FMUstate s) { memcpy(c, s, sizeof(Unit)); return fmi2OK; }
S(FreeFMUstate)(C c, fmi2FMUstate *s) { free(*s); *s = 0; return fmi2OK; }
S(EnterEventMode)(C c) { M; m->continuous = 0; return fmi2OK; }
S(EnterContinuousTimeMode)(C c) { M; m->continuous = 1; return fmi2OK; }
S(CompletedIntegratorStep)(C c, fmi2Boolean n, fmi2Boolean *e, fmi2Boolean *s) { *e = *s = 0; return fmi2OK; }
S(SetTime)(C c, double t) { M; m->t = t; return fmi2OK; }
S(SetContinuousStates)(C c, const double x[], size_t n) { M; memcpy(m->v, x, n * sizeof *x); return fmi2OK; }
S(GetContinuousStates)(C c, double x[], size_t n) { M; memcpy(x, m->v, n * sizeof *x); return fmi2OK; }
S(GetNominalsOfContinuousStates)(C c, double x[], size_t n) { for (size_t i = 0; i < n; i++) x[i] = 1; return fmi2OK; }
S(DoStep)(C c, double t, double dt, fmi2Boolean b) {
    M; for (int k = 0; k < 20; k++) walk(m, dt / 20); m->t = t + dt; return fmi2OK;
}

/* what a master may ask for and this unit does not offer */
#define NONE(name, ...) S(name)(C c, __VA_ARGS__) { return fmi2Error; }
NONE(GetInteger, const fmi2ValueReference r[], size_t n, fmi2Integer v[])
NONE(GetBoolean, const fmi2ValueReference r[], size_t n, fmi2Boolean v[])
NONE(GetString, const fmi2ValueReference r[], size_t n, fmi2String v[])
NONE(SetInteger, const fmi2ValueReference r[], size_t n, const fmi2Integer v[])
NONE(SetBoolean, const fmi2ValueReference r[], size_t n, const fmi2Boolean v[])
NONE(SetString, const fmi2ValueReference r[], size_t n, const fmi2String v[])
NONE(SerializedFMUstateSize, fmi2FMUstate s, size_t *n)
NONE(SerializeFMUstate, fmi2FMUstate s, fmi2Byte b[], size_t n)
NONE(DeSerializeFMUstate, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
NONE(GetDirectionalDerivative, const fmi2ValueReference a[], size_t n, const fmi2ValueReference b[], size_t k, const double d[], double e[])
NONE(SetRealInputDerivatives, const fmi2ValueReference r[], size_t n, const fmi2Integer o[], const double v[])
NONE(GetRealOutputDerivatives, const fmi2ValueReference r[], size_t n, const fmi2Integer o[], double v[])
S(CancelStep)(C c) { return fmi2Error; }
NONE(GetStatus, const fmi2StatusKind s, fmi2Status *v)
NONE(GetRealStatus, const fmi2StatusKind s, double *v)
NONE(GetIntegerStatus, const fmi2StatusKind s, fmi2Integer *v)
NONE(GetBooleanStatus, const fmi2StatusKind s, fmi2Boolean *v)
NONE(GetStringStatus, const fmi2StatusKind s, fmi2String *v)
