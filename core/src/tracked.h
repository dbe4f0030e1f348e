/* Inferences from tracked points that need no network. */
#ifndef BODYSENSE_TRACKED_H
#define BODYSENSE_TRACKED_H

#include "internal.h"

/* Set `implied` and `rotation` of joints that branch (pelvis, upper spine, wrists) if the points on them are seen. */
void imply_rotations(tracked *t);

/* Move a head that is not tracked with the points that are, from the points output in the frame before; NULL at first.
 * After this t->position[HEAD] is always set. */
void place_head(tracked *t, const vec3 *before);

#endif
