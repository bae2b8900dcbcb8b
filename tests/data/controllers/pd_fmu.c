/* A PD hold as an FMU for co-simulation: FMI 2.0, or FMI 3.0 with -DFMI=3. `-DFAULT=n` makes it do wrong from 4 s on:
 * 1 blocks, 2 crashes, 3 fails, 4 gives numbers that are none. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <unistd.h>
#ifndef FMI
#define FMI 2
#endif
#ifndef FAULT
#define FAULT 0
#endif

/* As tests/data/controllers/pd.c: kg, kg m2 about the centre of mass, and where that is, m. */
static const double MASS_KG = 21.52, INERTIA_KG_M2 = 6.0687, COM_M[2] = {0.4608, 0.0712};
static const double THRUST_N = 0.159, LEVER_M = 0.065;
enum { COUNT = 8, INPUTS = 7, BANDWIDTH = 20 };
static const double PUSHES[COUNT][3] = {{-1, 0, 1},  {-1, 0, -1}, {1, 0, -1}, {1, 0, 1},
                                        {0, -1, -1}, {0, -1, 1},  {0, 1, 1},  {0, 1, -1}};

struct model {
    double in[INPUTS]; /* x, y, theta, vx, vy, omega, state of the mission */
    double bandwidth_rad_s, goal[3], owed[COUNT], out[COUNT];
    int has_goal;
};

static void *make(void) {
    struct model *m = calloc(1, sizeof *m);
    if (m) m->bandwidth_rad_s = 0.5;
    return m;
}

static int advance(struct model *m, double t) {
    if (FAULT == 1 && t >= 4) sleep(3600);
    if (FAULT == 2 && t >= 4) abort();
    if (FAULT == 3 && t >= 4) return 3;
    for (int i = 0; i < COUNT; i++) m->out[i] = FAULT == 4 && t >= 4 ? NAN : 0;
    if (m->in[6] != 1) return 0;
    if (!m->has_goal) {
        for (int i = 0; i < 3; i++) m->goal[i] = m->in[i];
        m->has_goal = 1;
    }
    const double w = m->bandwidth_rad_s;
    double a[3];
    for (int i = 0; i < 3; i++) a[i] = -w * w * (m->in[i] - m->goal[i]) - 1.4 * w * m->in[3 + i];
    const double s = sin(m->in[2]), c = cos(m->in[2]);
    const double fx = MASS_KG * (c * a[0] + s * a[1] - a[2] * COM_M[1]);
    const double fy = MASS_KG * (c * a[1] - s * a[0] + a[2] * COM_M[0]);
    const double torque = INERTIA_KG_M2 * a[2] + COM_M[0] * fy - COM_M[1] * fx;
    for (int i = 0; i < COUNT; i++) {
        const double push = fmax(0, PUSHES[i][0] * fx) + fmax(0, PUSHES[i][1] * fy);
        m->owed[i] += fmin(1, push / (2 * THRUST_N) + fmax(0, PUSHES[i][2] * torque) / (4 * LEVER_M * THRUST_N));
        if (m->owed[i] >= 1) {
            if (!isnan(m->out[i])) m->out[i] = 1;
            m->owed[i] -= 1;
        }
    }
    return 0;
}

static double *at(struct model *m, uint32_t vr) {
    return vr == BANDWIDTH ? &m->bandwidth_rad_s : vr < INPUTS ? &m->in[vr] : &m->out[(vr - INPUTS) % COUNT];
}

static int get(void *m, const uint32_t *vr, size_t n, double *v) {
    for (size_t i = 0; i < n; i++) v[i] = *at(m, vr[i]);
    return 0;
}

static int set(void *m, const uint32_t *vr, size_t n, const double *v) {
    for (size_t i = 0; i < n; i++) *at(m, vr[i]) = v[i];
    return 0;
}

#if FMI == 2
void *fmi2Instantiate(const char *n, int t, const char *g, const char *r, const void *f, int v, int l) { return make(); }
int fmi2SetupExperiment(void *m, int td, double tol, double t0, int sd, double t1) { return 0; }
int fmi2EnterInitializationMode(void *m) { return 0; }
int fmi2ExitInitializationMode(void *m) { return 0; }
int fmi2Terminate(void *m) { return 0; }
void fmi2FreeInstance(void *m) { free(m); }
int fmi2DoStep(void *m, double t, double h, int no) { return advance(m, t); }
int fmi2GetReal(void *m, const uint32_t *vr, size_t n, double *v) { return get(m, vr, n, v); }
int fmi2SetReal(void *m, const uint32_t *vr, size_t n, const double *v) { return set(m, vr, n, v); }
int fmi2GetInteger(void *m, const uint32_t *vr, size_t n, int *v) { return 3; }
int fmi2SetInteger(void *m, const uint32_t *vr, size_t n, const int *v) { return 3; }
int fmi2GetBoolean(void *m, const uint32_t *vr, size_t n, int *v) { return 3; }
int fmi2SetBoolean(void *m, const uint32_t *vr, size_t n, const int *v) { return 3; }
#else
void *fmi3InstantiateCoSimulation(const char *n, const char *t, const char *r, bool v, bool l, bool e, bool ear, const uint32_t *iv,
                                  size_t niv, void *env, void *log, void *iu) { return make(); }
int fmi3EnterInitializationMode(void *m, bool td, double tol, double t0, bool sd, double t1) { return 0; }
int fmi3ExitInitializationMode(void *m) { return 0; }
int fmi3Terminate(void *m) { return 0; }
void fmi3FreeInstance(void *m) { free(m); }
int fmi3DoStep(void *m, double t, double h, bool no, bool *e, bool *end, bool *early, double *last) { return advance(m, t); }
int fmi3GetFloat64(void *m, const uint32_t *vr, size_t n, double *v, size_t nv) { return get(m, vr, n, v); }
int fmi3SetFloat64(void *m, const uint32_t *vr, size_t n, const double *v, size_t nv) { return set(m, vr, n, v); }
int fmi3GetInt32(void *m, const uint32_t *vr, size_t n, int32_t *v, size_t nv) { return 3; }
int fmi3SetInt32(void *m, const uint32_t *vr, size_t n, const int32_t *v, size_t nv) { return 3; }
int fmi3GetBoolean(void *m, const uint32_t *vr, size_t n, bool *v, size_t nv) { return 3; }
int fmi3SetBoolean(void *m, const uint32_t *vr, size_t n, const bool *v, size_t nv) { return 3; }
#endif
