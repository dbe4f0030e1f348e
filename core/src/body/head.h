/* The head as the network reads it. */
#ifndef BODYSENSE_HEAD_H
#define BODYSENSE_HEAD_H

#include "pose_state.h"

/* Whether the head's rotation is measured. */
typedef struct head_reading {
    bool turned;
    mat3 rotation;
} head_reading;

/* Give the network a head that it has seen in training. Returns the measured rotation, for `measured_head`.
 *
 * A rotation without a place is left out unless the model card has `reads_unplaced_head`: (0, 0, 0) would read as a head
 * on the floor. A place without a rotation gets the likeliest one: the chest's or the pelvis's, else level. */
head_reading readable_head(const bs_model *model, const pose_state *s, tracked *t);

/* Restore the head's rotation after the network has read it. */
void measured_head(head_reading measured, tracked *t);

/* Where a head faces that is no longer turned: as it last did, then where it goes along the floor. Horizontal, of length
 * one; zero before either is known. */
vec3 next_course(const pose_state *s, const tracked *t);

#endif
