/* Decaying offsets: hide jumps of the prediction when a sensor comes or goes. */
#ifndef BODYSENSE_OFFSET_DECAY_H
#define BODYSENSE_OFFSET_DECAY_H

#include "pose_state.h"

/* Continue the motion of predicted joints when the head, the pelvis, a hand or a foot comes or goes.
 *
 * Each joint gets an offset that cancels the jump and then decays. `s` must still hold the sensors of the frame
 * before. */
void decay_offsets(const tracked *t, pose_state *s, prediction *p);

#endif
