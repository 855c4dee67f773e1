/* An FMI 2 unit for model exchange and co-simulation around the right-hand side that to_c has written for a plant: compiled with
   -DMODEL="file.c" -DNX= -DNU= -DNP= -DNY= (states, inputs, parameters, outputs that are no states) and -DBEGIN= (their start). */
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"
#include MODEL

/* value references: states, derivatives, inputs, parameters, outputs */
#define N (2 * NX + NU + NP + NY)
typedef struct { double v[N], t; int continuous; fmi2CallbackLogger say; } Unit;

static void start(Unit *m) {
    static const double begin[N] = {BEGIN};
    memcpy(m->v, begin, sizeof m->v);
    m->t = m->continuous = 0;
}
static void rates(Unit *m) {
    double work[SIZE], *v = m->v;
    const double *given[8] = {v, v + 2 * NX};
    double *found[8] = {v + NX, NY ? v + 2 * NX + NU + NP : NULL};
    surrogate(given, found, NULL, work, 0);
}
#include "../physics/fmi2_unit.h"

S(NewDiscreteStates)(C c, fmi2EventInfo *e) { memset(e, 0, sizeof *e); return fmi2OK; }
S(GetDerivatives)(C c, double d[], size_t n) { M; rates(m); memcpy(d, m->v + NX, n * sizeof *d); return fmi2OK; }
S(GetEventIndicators)(C c, double z[], size_t n) { return fmi2OK; }
