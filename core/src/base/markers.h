/* Poses of takes by optical markers: a Gauss-Newton step of many frames, in double precision. For Python's library, no
 * part of bodysense.h. */
#ifndef BODYSENSE_MARKERS_H
#define BODYSENSE_MARKERS_H

#include "frames.h"

/* A body of `joints`, parents before their children, the root first, and the markers that they carry. */
typedef struct bs_worn_markers {
    int32_t joints, markers;
    const int32_t *parent; /* (joints) */
    const int32_t *joint;  /* (markers) the joint that carries each */
    const double *offset;  /* (markers, 3) m, in that joint's axes */
    const double *noise;   /* (markers) m, of each position */
} bs_worn_markers;

/* Replace `step` (frames, 3 + 3 joints), the pull of the prior, by the step of the poses: a translation of the root, and
 * turns of joints in world axes. `weight` (frames, 3 + 3 joints) are the prior's inverse variances, `position`
 * (frames, markers, 3) m has NaN for hidden markers, `place` (frames, joints, 3) m and `turn` (frames, joints, 3, 3) are
 * the joints' in the world, and `memory` holds 9 (joints + 1)² + 19 joints numbers. Nothing overlaps. */
BS_EXPORTED void bs_step_to_markers(const bs_worn_markers *worn, size_t frames, const double *position,
                                    const double *place, const double *turn, const double *weight, double *step,
                                    double *memory);

#endif
