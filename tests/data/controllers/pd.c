/* `pd`: holds the base where it finds it, by proportional and derivative control, in place of `base`. */

#include <fss.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fss_messages.h"
#include "pd_messages.h"

/* Navigation that is older counts as none, ns. */
#define OLDEST_NS 50000000u

enum { NAV, MISSION };
static const fss_topic INPUTS[] = {[NAV] = FSS_NAV_STATE, [MISSION] = FSS_MISSION_STATE};
enum { STATE, THRUSTERS };
static const fss_topic OUTPUTS[] = {[STATE] = pd_msgs__PdState__AT("/pd/state"), [THRUSTERS] = FSS_THRUSTERS_COMMAND};
enum { BANDWIDTH_RAD_S };
static const char *const KEYS[] = {[BANDWIDTH_RAD_S] = "bandwidth_rad_s"};

/* Of the default vehicle in the posture of `hold`: kg, kg m2 about the centre of mass, and where that is in base axes, m. */
static const double MASS_KG = 21.52, INERTIA_KG_M2 = 6.0687, COM_M[2] = {0.4608, 0.0712};
static const double THRUST_N = 0.159, LEVER_M = 0.065;
enum { COUNT = 8 };
/* Direction of each thruster's push in base axes, and which way it turns the base. */
static const double PUSHES[COUNT][3] = {{-1, 0, 1},  {-1, 0, -1}, {1, 0, -1}, {1, 0, 1},
                                        {0, -1, -1}, {0, -1, 1},  {0, 1, 1},  {0, 1, -1}};

struct service {
    double bandwidth_rad_s;
    int has_goal;
    double goal[3];
    double owed[COUNT];
};

static void *create(fss_ports *ports, const double *config, double rate_hz) {
    (void)rate_hz;
    struct service *self = calloc(1, sizeof *self);
    if (self == NULL || config[BANDWIDTH_RAD_S] <= 0.0) {
        fss_refuse(ports, "config: bandwidth_rad_s is more than zero");
        return self;
    }
    self->bandwidth_rad_s = config[BANDWIDTH_RAD_S];
    return self;
}

/* Share of open time of each thruster. */
static void duty_cycles(struct service *self, const fss_msgs__NavState *nav, double duty[COUNT]) {
    const double pose[3] = {nav->x_m, nav->y_m, nav->theta_rad};
    const double rate[3] = {nav->vx_m_s, nav->vy_m_s, nav->omega_rad_s};
    if (!self->has_goal) {
        memcpy(self->goal, pose, sizeof pose);
        self->has_goal = 1;
    }
    const double w = self->bandwidth_rad_s;
    double a[3];
    for (int i = 0; i < 3; i++) {
        a[i] = -w * w * (pose[i] - self->goal[i]) - 1.4 * w * rate[i];
    }
    const double s = sin(pose[2]), c = cos(pose[2]);
    const double fx = MASS_KG * (c * a[0] + s * a[1] - a[2] * COM_M[1]);
    const double fy = MASS_KG * (c * a[1] - s * a[0] + a[2] * COM_M[0]);
    const double torque = INERTIA_KG_M2 * a[2] + COM_M[0] * fy - COM_M[1] * fx;
    for (int i = 0; i < COUNT; i++) {
        const double push = fmax(0.0, PUSHES[i][0] * fx) + fmax(0.0, PUSHES[i][1] * fy);
        duty[i] = push / (2.0 * THRUST_N) + fmax(0.0, PUSHES[i][2] * torque) / (4.0 * LEVER_M * THRUST_N);
    }
}

static void step(void *service, fss_ports *ports, uint64_t now_ns) {
    struct service *self = service;
    const fss_msgs__NavState *nav = fss_latest(ports, NAV);
    const fss_msgs__MissionState *mission = fss_latest(ports, MISSION);
    fss_msgs__ThrustersCommand command = {.stamp_ns = now_ns, .valve_count = COUNT};
    pd_msgs__PdState state = {.stamp_ns = now_ns};
    const int is_fresh = nav != NULL && now_ns <= nav->stamp_ns + OLDEST_NS;
    if (is_fresh && mission != NULL && mission->state == fss_msgs__MissionState__RUNNING) {
        double duty[COUNT];
        duty_cycles(self, nav, duty);
        for (int i = 0; i < COUNT; i++) {
            /* A valve opens for a step when a step's impulse is owed. */
            self->owed[i] += fmin(duty[i], 1.0);
            if (self->owed[i] >= 1.0) {
                command.valves[i] = 1;
                self->owed[i] -= 1.0;
            }
        }
        state.speed_m_s = hypot(nav->vx_m_s, nav->vy_m_s);
        state.valid = 1;
    }
    fss_publish(ports, THRUSTERS, &command);
    fss_publish(ports, STATE, &state);
}

int main(int argc, char **argv) {
    const fss_service service = {
        .name = "pd",
        .inputs = INPUTS,
        .input_count = sizeof INPUTS / sizeof *INPUTS,
        .outputs = OUTPUTS,
        .output_count = sizeof OUTPUTS / sizeof *OUTPUTS,
        .keys = KEYS,
        .key_count = sizeof KEYS / sizeof *KEYS,
        .create = create,
        .step = step,
        .destroy = free,
    };
    return fss_main(argc, argv, &service);
}
