/* The clock: intervals between frames, and resets of motion. */
#ifndef BODYSENSE_CLOCK_H
#define BODYSENSE_CLOCK_H

#include "../base/internal.h"

/* Seconds since the frame `before` (NaN before the first), and whether motion is reset at `time`. */
bs_result clock_interval(const bs_settings *settings, double time, double before, double *interval, bool *fresh);

#endif
