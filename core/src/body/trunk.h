/* The trunk: hung on its head, its spine bent to a measured pelvis. */
#ifndef BODYSENSE_TRUNK_H
#define BODYSENSE_TRUNK_H

#include "../base/internal.h"

/* Place all points of a body with flat hands by its rotations and the place of its head (m, from base). */
void place(body *b, const tracked *t, vec3 head);

/* By how much (m) a body placed by its predicted head has to move so that a measured head, else a measured pelvis, else
 * the mean of the measured points is met. */
vec3 placement(const body *b, const tracked *t, const prediction *p);

/* By how much (m) a body of which no place was ever measured has to move so that it is on the floor. */
vec3 onto_floor(const body *b, const tracked *t);

/* How far (m) a measured pelvis, or measured hips, are from where the body has them. */
vec3 pelvis_off(const body *b, const tracked *t);

bool pelvis_seen(const tracked *t);

/* Turn the neck so that a measured chest, whose rotation is known, is where it is below a measured head. */
void turn_neck(body *b, const tracked *t);

/* Bend the spine so that the pelvis, which keeps its rotation, moves (m). Between the neck and the lowest joint of the
 * spine are two bones, of which the upper one is stiff; between a measured chest and that joint as well. */
void bend_spine(body *b, const tracked *t, vec3 move);

#endif
