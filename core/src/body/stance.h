/* Stance: the feet of a body that stands point where its pelvis does, or nearly. */
#ifndef BODYSENSE_STANCE_H
#define BODYSENSE_STANCE_H

#include "pose_state.h"

/* Turn predicted legs along with the pelvis of a body that stands, beyond what hips and knees turn.
 *
 * While people turn on the spot, the network predicts a mean of both feet, which stay behind the pelvis by up to 70°.
 * Legs are turned about the vertical through their hips. The turn fades while a point of a leg is measured. */
void turn_stance(const tracked *t, pose_state *s, prediction *p);

#endif
