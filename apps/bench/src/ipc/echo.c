/* The far end of `fss bench ipc` in C: sends back what comes, in a loop of its own. */

#include <fss.h>
#include <stdio.h>

#include "fss_messages.h"

/* So long it waits for a sample, ns. */
#define PATIENCE_NS 1000000000u

int main(int argc, char **argv) {
    fss_topic ping = FSS_NAV_STATE, pong = FSS_NAV_STATE;
    ping.topic = "/ping", pong.topic = "/pong";
    const fss_service echo = {.name = "echo", .inputs = &ping, .input_count = 1, .outputs = &pong, .output_count = 1};
    fss_ports *ports = fss_open(&echo, argc > 1 ? argv[1] : NULL, NULL);
    if (ports == NULL) {
        fprintf(stderr, "%s\n", fss_error());
        return 1;
    }
    fss_event(ports, FSS_INFO, "sends back what comes");
    uint64_t heard_ns = fss_take(ports);
    puts("ready");
    fflush(stdout);
    for (;;) {
        uint64_t now_ns = fss_take(ports);
        const fss_msgs__NavState *sample = fss_fresh(ports, 0);
        if (sample == NULL ? now_ns - heard_ns > PATIENCE_NS : sample->stamp_ns == UINT64_MAX) {
            break;
        }
        if (sample != NULL) {
            fss_publish(ports, 0, sample);
            heard_ns = now_ns;
        }
    }
    fss_close(ports);
    return 0;
}
