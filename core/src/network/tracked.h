/* Inferences from tracked points that need no network. */
#ifndef BODYSENSE_TRACKED_H
#define BODYSENSE_TRACKED_H

#include "../base/internal.h"

extern const signed char KNUCKLE[2][KNUCKLES]; /* of the left hand and the right one, from index to little finger */

/* Set `knuckle` and `has_knuckles`: a knuckle that is hidden is where the palm of the other three, which is stiff, has
 * it. */
void find_knuckles(tracked *t);

/* Set `implied` and `rotation` of joints that branch (pelvis, upper spine, wrists) if the points on them are seen.
 * Knuckles count where `find_knuckles` has them. */
void imply_rotations(tracked *t);

/* Move a head that is not tracked with the points that are, from the points output in the frame before; NULL at first.
 * After this t->position[HEAD] is always set. */
void place_head(tracked *t, const vec3 *before);

#endif
