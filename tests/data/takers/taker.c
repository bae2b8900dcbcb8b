/* `taker`: how many samples of navigation each step takes, where its config says what the test has written there. */

#include <fss.h>
#include <stdlib.h>
#include <string.h>

#include "fss_messages.h"
#include "taker_messages.h"

enum { NAV };
static const fss_topic INPUTS[] = {[NAV] = FSS_NAV_STATE};
enum { STATE };
static const fss_topic OUTPUTS[] = {[STATE] = taker_msgs__TakerState__AT("/taker/state")};
static const size_t EVERY[] = {NAV};
static const char *const OPTIONS[] = {"frame", "gains"};

static void *create(fss_ports *ports, const double *config, double rate_hz) {
    (void)config, (void)rate_hz;
    const char *frame = fss_option_text(ports, "frame");
    double second = 0.0;
    if (frame == NULL || strcmp(frame, "table") != 0 || fss_option_number(ports, "gains.kp.1", &second) != 0 || second != 2.5) {
        fss_refuse(ports, "config: frame or gains is not as it was written");
    }
    return calloc(1, sizeof(uint64_t));
}

static void step(void *last, fss_ports *ports, uint64_t now_ns) {
    uint64_t *sequence = last;
    taker_msgs__TakerState state = {.stamp_ns = now_ns, .valid = 1};
    for (size_t i = 0; i < fss_count(ports, NAV); i++) {
        const fss_msgs__NavState *nav = fss_sample(ports, NAV, i);
        state.valid = state.valid && nav->sequence == *sequence + 1;
        *sequence = nav->sequence;
        state.speed_m_s += 1.0;
    }
    fss_publish(ports, STATE, &state);
}

int main(int argc, char **argv) {
    const fss_service service = {
        .name = "taker",
        .inputs = INPUTS,
        .input_count = 1,
        .outputs = OUTPUTS,
        .output_count = 1,
        .create = create,
        .step = step,
        .destroy = free,
        .every = EVERY,
        .every_count = 1,
        .options = OPTIONS,
        .option_count = 2,
    };
    return fss_main(argc, argv, &service);
}
