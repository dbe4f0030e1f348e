/* Settling: what the prediction changes at once because a sensor came or went is taken back, and fades. */
#ifndef BODYSENSE_SETTLE_H
#define BODYSENSE_SETTLE_H

#include "pose.h"

/* Turn the predicted joints so that they go on as they moved when the head, the pelvis, a hand or a foot comes or
 * goes.
 *
 * `s` still holds what was tracked in the frame before. */
void settle(const tracked *t, pose_state *s, prediction *p);

#endif
