/* Blending a limb at a time: what sensors came or went, and how each limb goes on from what was output. */
#ifndef BODYSENSE_BLEND_H
#define BODYSENSE_BLEND_H

#include "limbs.h"

enum { TRUNK = LIMBS, GROUPS }; /* the limbs, and the trunk with the head */

/* The group of each joint of the body. */
extern const signed char JOINT_GROUP[BODY_JOINTS];

/* Which groups have a sensor that came or went. Fingers are in none. */
void find_changes(const tracked *t, const pose_state *s, bool changed[GROUPS]);

/* The heading that a limb is eased in, and goes along with while it is lost: the chest's for arms, the pelvis's for
 * legs. */
void limb_heading(const body *b, int limb, float *c, float *s);

/* Ease a limb's task, and keep an end that is lost where it was last seen for a while. */
void ease_limb(limb_task *task, const tracked *t, const bs_settings *settings, int limb, bool changed, float c,
               float sine, bool begun, limb_state *l);

/* Remember what a limb output. */
void remember_limb(const body *b, int limb, float interval, bool begun, limb_state *l);

#endif
