/* From what the network predicts to a body that meets what is measured and moves without jumps.
 *
 *     predicted body fitted to measured points → balanced over its feet → legs turned along with its pelvis → rotations:
 *     measured, implied or predicted → eased where sensors came or went → the body hung on its head → spine bent to the
 *     pelvis → legs, feet held and on the floor → arms → places
 */
#include "pose.h"

#include <string.h>

#include "../base/kinematics.h"
#include "../body/balance.h"
#include "../body/fit.h"
#include "../body/head.h"
#include "../body/offset_decay.h"
#include "../body/stance.h"
#include "../body/trunk.h"
#include "../limbs/arms.h"
#include "../limbs/legs.h"
#include "../network/tracked.h"
#include "../constants.h"

static const float LEAST_DOUBT = 1e-6F; /* m */

/* Joints that are turned by a measured point further on, with that point. Limbs are bent instead. */
static const signed char DIRECTED[][2] = {
    {SPINE1, SPINE2},  {SPINE2, SPINE3},     {NECK, HEAD},           {HEAD, HEAD_TOP},      {LEFT_COLLAR, LEFT_SHOULDER},
    {RIGHT_COLLAR, RIGHT_SHOULDER}, {LEFT_ANKLE, LEFT_FOOT}, {RIGHT_ANKLE, RIGHT_FOOT}, {LEFT_FOOT, LEFT_TOE},
    {RIGHT_FOOT, RIGHT_TOE},
};

/* The rotations to come to: measured or implied, else as predicted and turned onto measured points. */
static void rotation_goals(const tracked *t, const prediction *p, mat3 goal[BODY_JOINTS]) {
    for (int j = 0; j < BODY_JOINTS; j++) goal[j] = known_rotation(t, j) ? t->rotation[j] : p->rotation[j];
    for (size_t k = 0; k < sizeof(DIRECTED) / sizeof(DIRECTED[0]); k++) {
        int joint = DIRECTED[k][0], child = DIRECTED[k][1];
        if (known_rotation(t, joint) || !t->has_position[joint] || !t->has_position[child]) continue;
        vec3 bone = rotate(goal[joint], t->rest_offset[child]);
        vec3 apart = sub(t->position[child], t->position[joint]);
        /* The direction of two points is unreliable if their errors are comparable to their distance. */
        float doubt = 2.0F * (t->accuracy[joint] + t->accuracy[child]) + LEAST_DOUBT;
        float square = dot(bone, bone);
        goal[joint] = turned_onto(goal[joint], bone, mix(bone, apart, square / (square + doubt * doubt)));
    }
    if (!known_rotation(t, PELVIS) && t->has_position[LEFT_HIP] && t->has_position[RIGHT_HIP]) {
        vec3 line = rotate(goal[PELVIS], sub(t->rest_offset[LEFT_HIP], t->rest_offset[RIGHT_HIP]));
        goal[PELVIS] = turned_onto(goal[PELVIS], line, sub(t->position[LEFT_HIP], t->position[RIGHT_HIP]));
    }
}

/* Whether measured points turn a joint now that did not before, or no longer do. */
static bool redirected(const tracked *t, const pose_state *s, int j) {
    if (j == PELVIS) {
        bool had = s->had_position[LEFT_HIP] && s->had_position[RIGHT_HIP];
        return had != (t->has_position[LEFT_HIP] && t->has_position[RIGHT_HIP]);
    }
    for (size_t k = 0; k < sizeof(DIRECTED) / sizeof(DIRECTED[0]); k++) {
        if (DIRECTED[k][0] != j) continue;
        int child = DIRECTED[k][1];
        return (s->had_position[j] && s->had_position[child]) != (t->has_position[j] && t->has_position[child]);
    }
    return false;
}

void pose_start(pose_state *s) {
    memset(s, 0, sizeof *s);
    for (int k = 0; k < LIMBS; k++) s->limb[k].lost = -1.0F;
    for (int k = 0; k < 2; k++) s->wrist_lost[k] = -1.0F;
}

void pose_read(const bs_settings *settings, pose_state *s, tracked *t) {
    t->waning = t->interval * fminf(fmaxf(length(s->head_speed) / HEAD_STIRRED, HEAD_CALM), 1.0F);
    find_stand_ins(settings, s, t);
    find_knuckles(t);
    imply_rotations(t);
    place_head(t, s->begun ? s->point : NULL);
    for (int k = 0; k < BODY_POINTS && settings->ease == 0; k++)
        t->at_once |= s->begun && t->has_position[BODY_POINT[k]] && !s->had_position[BODY_POINT[k]];
}

void pose_body(const bs_settings *settings, const tracked *t, prediction *p, pose_state *s, body *out) {
    bool changed[GROUPS], begun = s->begun;
    mat3 goal[BODY_JOINTS];
    float interval = t->interval;
    fit_prediction(t, s, p);
    balance_prediction(t, s, p);
    turn_stance(t, s, p);
    decay_offsets(t, s, p);
    find_changes(t, s, changed);
    rotation_goals(t, p, goal);
    for (int j = 0; j < BODY_JOINTS; j++) {
        bool known = known_rotation(t, j), came = begun && known != (s->had_rotation[j] != 0);
        bool wrist = j == LEFT_WRIST || j == RIGHT_WRIST;
        bool breaks = wrist ? came && known : came || (changed[JOINT_GROUP[j]] && !known);
        breaks |= begun && !known && redirected(t, s, j);
        float span = known || t->at_once ? (float)settings->ease : BLEND;
        out->rotation[j] = eased_turn(&s->turn[j], goal[j], s->rotation[j], s->spin[j], interval, breaks, span);
    }

    /* The base of the body is its head, its pelvis or its measured points. */
    place(out, t, p->head);
    for (int q = 0; q < BS_POINTS; q++)
        if (t->has_position[q]) s->has_measured_position = 1;
    vec3 head = add(p->head, s->has_measured_position ? placement(out, t, p) : onto_floor(out, t));
    bool head_breaks = begun && (t->has_position[HEAD] != (s->had_position[HEAD] != 0) ||
                                 (!t->has_position[HEAD] && (changed[TRUNK] || changed[LEFT_ARM] || changed[RIGHT_ARM])));
    head = eased(&s->head, head, s->point[HEAD], s->head_speed, interval, head_breaks,
                 t->has_position[HEAD] ? (float)settings->ease : BLEND, 0.0F);
    place(out, t, head);

    turn_neck(out, t);

    /* The spine bends to a measured pelvis. */
    bool pelvis_breaks = false;
    for (int j = PELVIS; j <= RIGHT_HIP; j++)
        pelvis_breaks |= begun && t->has_position[j] != (s->had_position[j] != 0);
    vec3 wanted = add(out->point[PELVIS], pelvis_off(out, t));
    wanted = eased(&s->pelvis, wanted, s->pelvis_bent, s->pelvis_speed, interval, pelvis_breaks,
                   pelvis_seen(t) ? (float)settings->ease : BLEND, 0.0F);
    bend_spine(out, t, sub(wanted, out->point[PELVIS]));
    s->pelvis_speed = scale(sub(out->point[PELVIS], s->pelvis_bent), begun ? 1.0F / interval : 0.0F);
    s->pelvis_bent = out->point[PELVIS];

    /* Legs first: the pelvis may be moved for them, and the chest with it. */
    move_legs(out, t, p, goal, settings, changed, s);
    keep_wrists(out, t, s);
    move_arm(out, t, goal, settings, LEFT_ARM, changed[LEFT_ARM], s);
    move_arm(out, t, goal, settings, RIGHT_ARM, changed[RIGHT_ARM], s);
    place(out, t, head);
}

void pose_finish(const tracked *t, pose_state *s, body *out, float off[BS_POINTS]) {
    place_points(out, t->rest_offset, HEAD, out->point[HEAD], BS_POINTS);
    float rate = s->begun ? 1.0F / t->interval : 0.0F;
    s->head_speed = scale(sub(out->point[HEAD], s->point[HEAD]), rate);
    s->course = next_course(s, t);
    for (int k = 0; k < LIMBS; k++) remember_limb(out, k, t->interval, s->begun, &s->limb[k]);
    for (int j = 0; j < BODY_JOINTS; j++) {
        s->spin[j] = scale(turn_between(s->rotation[j], out->rotation[j]), rate);
        s->rotation[j] = out->rotation[j];
        s->had_rotation[j] = known_rotation(t, j);
    }
    for (int k = 0; k < 2; k++)
        if (known_rotation(t, LEFT_WRIST + k))
            s->wrist_kept[k] = product(transpose(chest_heading(out)), out->rotation[LEFT_WRIST + k]);
    for (int p = 0; p < BS_POINTS; p++) {
        s->point[p] = out->point[p];
        s->had_position[p] = t->has_position[p];
        off[p] = t->has_position[p] ? distance(t->position[p], out->point[p]) : 0.0F;
    }
    s->begun = 1;
}
