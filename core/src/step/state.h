/* The state of one person: plain bytes, followed by the network's memory. */
#ifndef BODYSENSE_STATE_H
#define BODYSENSE_STATE_H

#include "../body/pose_state.h"
#include "../person/mounts.h"
#include "../person/person.h"

struct bs_state {
    char format[8];    /* STATE_FORMAT */
    uint64_t model;    /* fingerprint */
    uint64_t size;     /* bytes, the network's memory included */
    double time;       /* s, of the frame before; NaN before the first */
    double base[3];    /* m, world: whole numbers near where motion started; places count from there */
    bs_person person;  /* known parts of the body */
    proportions proportions;
    mounts mounts;
    pose_state pose;
};

#define STATE_FORMAT "bstate2"
#define ALIGNMENT 64

/* Bytes, rounded up to whole lines of the cache. */
static inline size_t aligned(size_t bytes) { return (bytes + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT; }

static inline bool is_aligned(const void *memory) { return (uintptr_t)memory % ALIGNMENT == 0; }

/* The network's memory of a person. */
static inline float *state_memory(bs_state *state) { return (float *)(void *)((char *)state + aligned(sizeof *state)); }

#endif
