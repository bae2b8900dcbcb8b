/* libfss: a service of a floating spacecraft simulator, written in C.
 *
 * A service is a name, topics that it reads and writes, and a pure step. fss_main makes it the program that a launcher starts,
 * watches, restarts and stops, records and replays as it does fss's own services. The step reads no clock, opens nothing and
 * allocates nothing: then it flies on any clock, and gives the same bits again from a log.
 *
 * Messages: `fss messages --c` prints fss's own as structs, `fss messages --c FILE.msg` one's own.
 * Link with libfss.so, or with libfss.a, -lpthread, -ldl and -lm. */
#ifndef FSS_H
#define FSS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A topic with its message, such as FSS_NAV_STATE of the generated header. */
typedef struct {
    const char *topic;      /* its name, such as "/nav/state" */
    const char *schema;     /* "package/msg/Name" */
    const char *definition; /* the ROS 2 definition of the message */
    size_t size;            /* sizeof its struct */
} fss_topic;

/* The ports of a service while one of its functions runs. */
typedef struct fss_ports fss_ports;

/* What a service is. */
typedef struct {
    const char *name;         /* as in the launch file: up to 15 lower-case letters, digits and underscores */
    const fss_topic *inputs;  /* what it reads; at most 8 */
    size_t input_count;
    const fss_topic *outputs; /* what it writes */
    size_t output_count;
    const char *const *keys;  /* the keys of its config in the launch file, all of them numbers, and all required */
    size_t key_count;
    /* Makes the service before its first step; `config` are the values in the order of `keys`. Returns what the other two
     * functions are given. Where it cannot fly so it calls fss_refuse. */
    void *(*create)(fss_ports *ports, const double *config, double rate_hz);
    /* One step at now_ns. */
    void (*step)(void *self, fss_ports *ports, uint64_t now_ns);
    /* Ends it; may be NULL. */
    void (*destroy)(void *self);
    /* Places of the inputs of which a step takes every sample; of the others it has the newest. */
    const size_t *every;
    size_t every_count;
    /* Further keys of its config: texts, tables and lists, none of them required. */
    const char *const *options;
    size_t option_count;
} fss_service;

/* Runs the service as the launcher's command line says; returns what main shall return. */
int fss_main(int argc, char **argv, const fss_service *service);

/* In create: the service cannot fly, and why. */
void fss_refuse(fss_ports *ports, const char *reason);

/* In create: the text, or the number, at a place of the options: "frame", "gains.kp", "names.0"; true counts as 1. NULL, or -1, where
 * there is none. A text stays as long as the service does. */
const char *fss_option_text(const fss_ports *ports, const char *path);
int fss_option_number(const fss_ports *ports, const char *path, double *value);

/* In create: all options as JSON. */
const char *fss_options(const fss_ports *ports);

/* In step: the newest sample of an input, by its place in `inputs`; NULL where there never was one. It stays until a newer one
 * comes, so look at its age. */
const void *fss_latest(const fss_ports *ports, size_t input);

/* In step: the same, if it came since the last step. */
const void *fss_fresh(const fss_ports *ports, size_t input);

/* In step: how many samples of an input came since the last step, at most 64, where `every` names it; 0 or 1 where not. And one of
 * them, the oldest first; NULL where there are not so many. */
size_t fss_count(const fss_ports *ports, size_t input);
const void *fss_sample(const fss_ports *ports, size_t input, size_t place);

/* In step: publishes a sample on an output, by its place in `outputs`, when the step has ended. The caller sets stamp_ns; sequence
 * and published_ns are set for it. Returns 0, or -1 where there is no such output or 64 samples wait already. */
int fss_publish(fss_ports *ports, size_t output, const void *sample);

/* A program with a loop of its own, which no launcher starts, watches or replays: a display, a test, a bridge to something else. It
 * joins a stack that runs, by the stack's prefix in shared memory: "fss_N_" where N is the process number of `fss run`, or what --bus of
 * a service says. `vehicle` is the vehicle's name, NULL or "" where it has none. Of the service count its name, inputs, outputs and
 * `every`. Returns NULL where it cannot, or no such stack runs; fss_error says why, until the thread's next fss_open. The ports belong to
 * one thread. */
fss_ports *fss_open(const fss_service *service, const char *bus, const char *vehicle);
const char *fss_error(void);

/* In such a loop: takes what has come since the last time, as the begin of a step does, and returns the time, ns. fss_latest, fss_fresh,
 * fss_count and fss_sample tell of it until the next time. What fss_publish and fss_event are given is sent at once. */
uint64_t fss_take(fss_ports *ports);

/* Leaves the stack; the ports and their samples are gone then. */
void fss_close(fss_ports *ports);

/* Severities of events. */
enum { FSS_DEBUG = 0, FSS_INFO = 1, FSS_WARNING = 2, FSS_ERROR = 3, FSS_CRITICAL = 4 };

/* In step: says in /events that something happened; up to 159 bytes of UTF-8. */
void fss_event(fss_ports *ports, uint8_t severity, const char *text);

#ifdef __cplusplus
}
#endif
#endif
