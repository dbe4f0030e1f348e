/* Legs: to measured or predicted ankles, with feet that stand on the floor. */
#ifndef BODYSENSE_LEGS_H
#define BODYSENSE_LEGS_H

#include "blend.h"

/* Bend both legs, and move a pelvis that is not measured so far that they reach. */
void move_legs(body *b, const tracked *t, const prediction *p, const mat3 goal[BODY_JOINTS],
               const bs_settings *settings, const bool changed[GROUPS], pose_state *s);

#endif
