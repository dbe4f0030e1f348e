/* Arms: from a shoulder that may be pulled by its collar to a measured or predicted wrist. */
#ifndef BODYSENSE_ARMS_H
#define BODYSENSE_ARMS_H

#include "blend.h"

/* Bend an arm. `goal` are the rotations of the body's joints before easing. */
void move_arm(body *b, const tracked *t, const mat3 goal[BODY_JOINTS], const bs_settings *settings, int limb,
              bool changed, pose_state *s);

/* Turn wrists whose rotation is lost: they keep it to the chest, and give it up slowly. */
void keep_wrists(body *b, const tracked *t, pose_state *s);

/* The heading of the chest as a rotation. */
mat3 chest_heading(const body *b);

#endif
