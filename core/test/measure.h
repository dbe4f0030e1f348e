/* How numbers are measured: frames, thresholds, and a body at rest. */
#ifndef BODYSENSE_MEASURE_H
#define BODYSENSE_MEASURE_H

#include "../src/base/kinematics.h"

#define TICK 0.005F /* s between two frames of a measure */
#define FOREVER 60000

typedef double measure(const bs_model *model);

/* The least number of [low, high] for which a test holds that holds above it. */
#define LEAST(low, high, test)                                  \
    double from_ = (low), to_ = (high);                         \
    for (int round_ = 0; round_ < 40; round_++) {               \
        const double at = 0.5 * (from_ + to_);                  \
        if (test) to_ = at;                                     \
        else from_ = at;                                        \
    }                                                           \
    return to_

#endif
