/* The clock: intervals between frames, and where motion starts anew. */
#ifndef BODYSENSE_CLOCK_H
#define BODYSENSE_CLOCK_H

#include "internal.h"

/* Seconds since the frame `before` (NaN if there was none), and whether motion starts anew at `time`. */
bs_result clock_interval(const bs_settings *settings, double time, double before, double *interval, bool *fresh);

#endif
