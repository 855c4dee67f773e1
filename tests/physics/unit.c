/* An FMI 2 unit for model exchange and co-simulation: a pendulum, or with -DBALL=1 a ball that bounces (a state event) under a
   load from t = 0.35 on (a time event). With wear every bounce is weaker: a memory that is no continuous state. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"

/* value references: 0, 1 states; 2, 3 derivatives; 4 input; 5 - 8 parameters; 9 output */
#define N 10
#define NX 2
#define NU 1
typedef struct { double v[N], t, load, bounces; int continuous; fmi2CallbackLogger say; } Unit;

static void start(Unit *m) {
    static const double begin[2][N] = {{0.5, 0, 0, 0, 0, 9, 0.4, 0, 0, 0}, {1, 0, 0, 0, 0, 9.81, 0.8, 0, 0, 0}};
    memcpy(m->v, begin[BALL], sizeof m->v);
    m->t = m->load = m->bounces = m->continuous = 0;
}
static void rates(Unit *m) {
    double *v = m->v;
    v[2] = v[1];
    v[3] = BALL ? v[4] - v[5] - m->load : v[4] - v[5] * sin(v[0]) - v[6] * v[1];
    v[9] = v[5] * sin(v[0]);
}
#include "fmi2_unit.h"

S(NewDiscreteStates)(C c, fmi2EventInfo *e) {
    M; double *v = m->v;
    memset(e, 0, sizeof *e);
    if (BALL && v[0] <= 0 && v[1] < 0) {
        v[1] *= -v[6] * pow(1 - v[8], m->bounces++);
        e->valuesOfContinuousStatesChanged = 1;
    }
    m->load = BALL && m->t >= 0.35 ? v[7] : 0;
    e->nextEventTimeDefined = BALL && m->t < 0.35;
    e->nextEventTime = 0.35;
    return fmi2OK;
}
S(GetDerivatives)(C c, double d[], size_t n) {
    M;
    if (fabs(m->v[1]) > 1e3 || isnan(m->v[1])) {
        m->say(NULL, "unit", fmi2Error, "error", "too fast for this model");
        return fmi2Error;
    }
    rates(m); memcpy(d, m->v + 2, n * sizeof *d); return fmi2OK;
}
S(GetEventIndicators)(C c, double z[], size_t n) { M; if (n) z[0] = m->v[0]; return fmi2OK; }
