/* From what the network predicts to a body that meets what is measured and moves without jumps. */
#ifndef BODYSENSE_POSE_H
#define BODYSENSE_POSE_H

#include "../body/pose_state.h"

void pose_start(pose_state *s);

/* Rotations that measured points imply, points that stand in for others, and the head's place, before the network. */
void pose_read(const bs_settings *settings, pose_state *s, tracked *t);

/* The body without its fingers: rotations of the body's joints, and all points of a body with flat hands. */
void pose_body(const bs_settings *settings, const tracked *t, prediction *p, pose_state *s, body *out);

/* After the fingers: place all points, find how far measured points are off (m), remember what was output. */
void pose_finish(const tracked *t, pose_state *s, body *out, float off[BS_POINTS]);

#endif
