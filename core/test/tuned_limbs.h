/* Numbers of jumps, limbs, head, trunk, and of bounds of errors. */
#ifndef BODYSENSE_TUNED_LIMBS_H
#define BODYSENSE_TUNED_LIMBS_H

#include "../src/body/fit.h"
#include "../src/body/head.h"
#include "../src/body/offset_decay.h"
#include "../src/body/trunk.h"
#include "../src/limbs/arms.h"
#include "../src/limbs/legs.h"
#include "../src/network/network.h"
#include "../src/step/pose.h"
#include "measure.h"

/* ---- jumps ------------------------------------------------------------------------------------------------------- */

static double ease_ramp(const bs_model *m) {
    ease e = ease_begin(vec(1, 0, 0), 1.0F);
    (void)m;
    e.age = 0.2F;
    return 1.0 - (double)ease_offset(&e).x;
}

static double ease_fastest(const bs_model *m) {
    ease e = {.span = 0};
    (void)m;
    eased(&e, vec(0, 0, 0), vec(100, 0, 0), vec(0, 0, 0), TICK, true, 0.1F, 0);
    return (double)e.span;
}

static double offset_half_life(const bs_model *m) {
    static pose_state s;
    static tracked t;
    static prediction p;
    int frames = 0;
    (void)m;
    memset(&s, 0, sizeof s);
    s.begun = 1;
    t.interval = TICK;
    for (int j = 0; j < BODY_JOINTS; j++) s.offset_decay[j].predicted = identity();
    s.offset_decay[NECK].off = vec(0.1F, 0, 0);
    do {
        for (int j = 0; j < BODY_JOINTS; j++) p.rotation[j] = identity();
        decay_offsets(&t, &s, &p);
    } while (++frames < FOREVER && s.offset_decay[NECK].off.x > 0.05F);
    return (double)frames * (double)TICK;
}

/* The offset of a neck that spun at 1 rad/s and is predicted to be still: in a frame with a change, or in the next. */
static offset_decay stopped(bool changes) {
    static pose_state s;
    static tracked t;
    static prediction p;
    memset(&s, 0, sizeof s);
    s.begun = 1;
    t.interval = TICK;
    for (int j = 0; j < BODY_JOINTS; j++) s.offset_decay[j].predicted = p.rotation[j] = identity();
    s.offset_decay[NECK].spin = vec(1, 0, 0);
    t.has_position[HEAD] = changes;
    s.sensors_changed = !changes;
    decay_offsets(&t, &s, &p);
    return s.offset_decay[NECK];
}

static double offset_trusted(const bs_model *m) { (void)m; return (double)stopped(true).spin.x; }
static double offset_carried(const bs_model *m) { (void)m; return (double)stopped(false).speed.x; }

/* ---- limbs ------------------------------------------------------------------------------------------------------- */

/* Seconds in which half of what an output kept of a lost limb is gone, or how far it went in half a second (m). */
static double lost_limb(int limb, double height, double speed, bool far) {
    static tracked t;
    const bs_settings settings = bs_default_settings();
    limb_state l = {.lost = -1, .seen = 2};
    l.end_output = vec(1, 0.6F * (float)height, 0);
    l.end_speed = vec(0, 0, (float)speed);
    int frames = 0;
    t.interval = t.waning = TICK;
    for (;;) {
        limb_task task = {.upper = vec(0.3F, 0, 0), .lower = vec(0.3F, 0, 0)};
        ease_limb(&task, &t, &settings, limb, false, 1, 0, true, &l);
        if (far && ++frames == 100) return (double)task.end.z;
        if (!far && (++frames == FOREVER || task.end.x < 0.5F)) return (double)frames * (double)TICK;
    }
}

static double lost_leg(const bs_model *m) { (void)m; return lost_limb(LEFT_LEG, -0.3, 0, false); }
static double lost_arm(const bs_model *m) { (void)m; return lost_limb(LEFT_ARM, -0.3, 0, false); }
static double lost_raised(const bs_model *m) { (void)m; return lost_limb(LEFT_ARM, 0.6, 0, false); }
static double lost_low(const bs_model *m) { (void)m; return lost_limb(LEFT_ARM, -0.9, 0, false); }
static double lost_leaving(const bs_model *m) { (void)m; return lost_limb(LEFT_ARM, 0.6, 1, true); }
static double raised_from(const bs_model *m) { (void)m; return lost_limb(LEFT_ARM, 0, 0, false); }
static double low_hand(const bs_model *m) { (void)m; return lost_limb(LEFT_ARM, -0.6, 0, false); }
static double low_hand_speed(const bs_model *m) { (void)m; return lost_limb(LEFT_ARM, -0.9, 0.2, false); }

/* A limb whose sensors came or went while it was predicted, and the frame after: the hand was fast, its goal is not. */
static double blended(bool slope) {
    static tracked t;
    const bs_settings settings = bs_default_settings();
    limb_state l = {.lost = -1, .end_speed = vec(0, 0, 100)};
    t.interval = TICK;
    for (int k = 0; k < 2; k++) {
        limb_task task = {.upper = vec(0.3F, 0, 0), .lower = vec(0.3F, 0, 0)};
        ease_limb(&task, &t, &settings, LEFT_ARM, k == 0, 1, 0, true, &l);
    }
    return slope ? (double)length(l.end.slope) : (double)l.end.span;
}

static double blend(const bs_model *m) { (void)m; return blended(false); }
static double arm_steepest(const bs_model *m) { (void)m; return blended(true); }

static float waning_at(float speed) {
    static pose_state s;
    static tracked t;
    const bs_settings settings = bs_default_settings();
    memset(&t, 0, sizeof t);
    t.interval = TICK;
    t.has_position[HEAD] = true;
    s.head_speed = vec(speed, 0, 0);
    pose_read(&settings, &s, &t);
    return t.waning / TICK;
}

static double head_stirred(const bs_model *m) { (void)m; return (double)waning_at(0.05F); }
static double head_calm(const bs_model *m) { (void)m; return (double)waning_at(0); }

/* A body in its rest pose, as the likeliest one of 1.7 m, with its head 2 m over base. */
static tracked rest_of(const bs_model *model, body *b) {
    tracked t;
    bs_person person = {.height = 1.7, .height_deviation = 0.01};
    memset(&t, 0, sizeof t);
    if (bs_person_likeliest(model, &person) != BS_OK) exit(1);
    for (int p = 0; p < BS_POINTS; p++) {
        const double *o = person.rest_offset[p];
        t.rest_offset[p] = vec((float)o[0], (float)o[1], (float)o[2]);
    }
    t.interval = TICK;
    for (int j = 0; j < BS_JOINTS; j++) b->rotation[j] = t.rotation[j] = identity();
    place_points(b, t.rest_offset, HEAD, vec(0, 2, 0), BS_POINTS);
    t.position[HEAD] = b->point[HEAD];
    t.has_position[HEAD] = true;
    t.floor = 2.0F - standing_height(&t, HEAD);
    return t;
}

/* The goal of a limb that is straight: how far its middle is to the natural side, of its length. */
static double side_of(const bs_model *model, int limb, bool hinged) {
    static body b;
    tracked t = rest_of(model, &b);
    const limb_joints *j = &LIMB[limb];
    if (hinged) {
        t.has_position[j->end] = t.has_rotation[j->end] = true;
        t.position[j->end] = b.point[j->end];
        t.rotation[j->end] = (mat3){{0, 0, 1}, {0, 1, 0}, {-1, 0, 0}};
    }
    const limb_task task = limb_goal(&t, limb, b.rotation, &b, b.point[j->start]);
    if (hinged) return (double)fabsf(task.middle.x);
    return (double)(fabsf(task.middle.z - task.upper.z) / (length(task.upper) + length(task.lower)));
}

static double arm_bent(const bs_model *m) { return side_of(m, LEFT_ARM, false); }
static double leg_bent(const bs_model *m) { return side_of(m, LEFT_LEG, false); }
static double knee_hinge(const bs_model *m) { return side_of(m, LEFT_LEG, true); }
static double limb_straight(const bs_model *m) { (void)m; return (double)reach(vec(9, 0, 0), 0.5F, 0.5F, UP).end.x; }

/* An elbow that is bent about an axis, its sine, and how far its arm is turned about its upper bone (rad). */
static double hinged(const bs_model *model, float bent) {
    static body b;
    const tracked t = rest_of(model, &b);
    const hinge_state none = {0, 0};
    b.rotation[LEFT_ELBOW] = turned_by(identity(), vec(0, -asinf(bent), 0));
    hinge_elbow(&b, &t, LEFT_ARM, &none);
    return (double)length(turn_between(identity(), b.rotation[LEFT_SHOULDER]));
}

static double hinge_from(const bs_model *m) { return hinged(m, 0.15F) / hinged(m, 1); }
static double hinge_upright(const bs_model *m) { return hinged(m, 1); }

static double learned(const bs_model *model, int frames) {
    static body b;
    const tracked t = rest_of(model, &b);
    hinge_state hinge = {0, 0};
    b.rotation[LEFT_ELBOW] = turned_by(identity(), vec(0, -1.5707963F, 0));
    for (int k = 0; k < frames; k++) learn_hinge(&t, LEFT_ARM, b.rotation, &hinge);
    return (double)fabsf(hinge.upright);
}

static double hinge_rate(const bs_model *m) { return learned(m, 1) / (double)TICK; }
static double hinge_most(const bs_model *m) { return learned(m, 20000); }

/* How far a left arm turns its collar (rad): its shoulder or its wrist is measured `up` higher (m). */
static double pulled(const bs_model *model, int joint, float up, bool share) {
    static body b;
    static pose_state s;
    const bs_settings settings = bs_default_settings();
    tracked t = rest_of(model, &b);
    pose_start(&s);
    t.has_position[joint] = true;
    t.position[joint] = along(b.point[joint], UP, up);
    t.accuracy[joint] = 0.04F;
    if (joint == LEFT_WRIST) t.position[joint] = along(b.point[LEFT_SHOULDER], UP, up);
    const vec3 before = b.point[LEFT_SHOULDER], collar = b.point[LEFT_COLLAR];
    move_arm(&b, &t, b.rotation, &settings, LEFT_ARM, false, &s);
    const vec3 bone = rotate(b.rotation[LEFT_COLLAR], t.rest_offset[LEFT_SHOULDER]);
    if (share) return (double)((collar.y + bone.y - before.y) / up);
    return (double)length(turn_between(identity(), b.rotation[LEFT_COLLAR]));
}

static double collar_doubt(const bs_model *m) { return pulled(m, LEFT_SHOULDER, 0.005F, true); }
static double collar_gives(const bs_model *m) { return pulled(m, LEFT_WRIST, 3, false); }

static double wrist_kept(const bs_model *model) {
    static pose_state s;
    static body b;
    tracked t = rest_of(model, &b);
    int frames = 0;
    pose_start(&s);
    t.interval = 0.05F;
    s.wrist_lost[0] = 0.0F;
    s.wrist_kept[0] = turned_by(identity(), vec(0.5F, 0, 0));
    do {
        b.rotation[LEFT_WRIST] = identity();
        keep_wrists(&b, &t, &s);
    } while (++frames < FOREVER && length(turn_between(identity(), b.rotation[LEFT_WRIST])) > 0.25F);
    return (double)frames * 0.05;
}

/* ---- head, trunk and pelvis -------------------------------------------------------------------------------------- */

static vec3 course_at(double speed, float interval) {
    static pose_state s;
    static tracked t;
    s.course = vec(0, 0, 1);
    s.head_speed = vec((float)speed, 0, 0);
    t.interval = interval;
    return next_course(&s, &t);
}

static double course_speed(const bs_model *m) { (void)m; LEAST(0, 3, course_at(at, 0.5F).x > 0); }

static double course_half_life(const bs_model *m) {
    const vec3 half = course_at(2, 0.5F);
    (void)m;
    return (double)(half.x / (half.x + half.z));
}

static double fit_fade(const bs_model *model) {
    static body b;
    static pose_state s;
    static prediction p;
    const tracked t = rest_of(model, &b);
    int frames = 0;
    memset(&s, 0, sizeof s);
    s.begun = 1;
    s.had_position[HEAD] = 1;
    s.fitting[LEFT_ELBOW].off = vec(0.1F, 0, 0);
    do {
        for (int j = 0; j < BODY_JOINTS; j++) p.rotation[j] = identity();
        p.head = b.point[HEAD];
        fit_prediction(&t, &s, &p);
    } while (++frames < FOREVER && s.fitting[LEFT_ELBOW].off.x > 0.0368F);
    return (double)frames * (double)TICK;
}

/* How far feet that hover 5 cm over the floor are lowered, of how far those of a body that stands are: `high` and
 * `carried` are the heights of head and pelvis, of those of a body that stands; `up` is the head's speed (m/s). */
static double upright_at(const bs_model *model, double high, double carried, double up) {
    static body b;
    static pose_state s;
    static prediction p;
    const bs_settings settings = bs_default_settings();
    const bool changed[GROUPS] = {false};
    double drop[2];
    for (int k = 0; k < 2; k++) {
        tracked t = rest_of(model, &b);
        pose_start(&s);
        t.floor -= 0.05F;
        if (k) {
            b.point[HEAD].y = t.floor + (float)high * standing_height(&t, HEAD);
            b.point[PELVIS].y = t.floor + (float)carried * standing_height(&t, PELVIS);
            s.head_speed = vec(0, (float)up, 0);
        } else b.point[HEAD].y = t.floor + standing_height(&t, HEAD);
        move_legs(&b, &t, &p, b.rotation, &settings, changed, &s);
        drop[k] = (double)s.foot[0].drop;
    }
    return drop[1] / drop[0];
}

static double head_low(const bs_model *m) { return upright_at(m, 0.735, 0.3, 0); }
static double pelvis_low(const bs_model *m) { return upright_at(m, 0.4, 0.8, 0); }
static double head_stretched(const bs_model *m) { return upright_at(m, 0.85, 1, -1.5) + upright_at(m, 0.97, 1, -1.0); }
static double head_steady(const bs_model *m) { return upright_at(m, 0.98, 1, 0.5); }
static double head_falling(const bs_model *m) { return upright_at(m, 0.85, 1, -1.5); }

static double head_over(const bs_model *model) {
    static body b;
    const tracked t = rest_of(model, &b);
    const double tall = (double)standing_height(&t, HEAD);
    LEAST(0, 0.2, upright_at(model, 1 + at / tall, 1, 0) <= 0);
}

/* How far a foot that hangs behind a knee at a height over the floor (m) is lowered, though the body does not stand. */
static double lowered(const bs_model *model, float knee) {
    static body b;
    static pose_state s;
    static prediction p;
    const bs_settings settings = bs_default_settings();
    const bool changed[GROUPS] = {false};
    tracked t = rest_of(model, &b);
    pose_start(&s);
    for (int k = 0; k < 2; k++) b.rotation[LEFT_KNEE + k] = turned_by(identity(), vec(1.5707963F, 0, 0));
    t.floor = b.point[LEFT_KNEE].y - knee;
    b.point[HEAD].y = b.point[PELVIS].y = t.floor;
    move_legs(&b, &t, &p, b.rotation, &settings, changed, &s);
    return (double)s.foot[0].drop;
}

static double knee_down(const bs_model *m) { return lowered(m, 0.16F); }

static double pelvis_settle(const bs_model *model) {
    static body b;
    static pose_state s;
    static prediction p;
    const bs_settings settings = bs_default_settings();
    const bool changed[GROUPS] = {false};
    int frames = 0;
    pose_start(&s);
    s.standing_drop = 0.1F;
    do {
        tracked t = rest_of(model, &b);
        move_legs(&b, &t, &p, b.rotation, &settings, changed, &s);
    } while (++frames < FOREVER && s.standing_drop > 0.05F);
    return (double)frames * (double)TICK;
}

/* How far a pelvis goes for an ankle that is measured 2 m before its hip (m). */
static double pelvis_most_shift(const bs_model *model) {
    static body b;
    static pose_state s;
    static prediction p;
    const bs_settings settings = bs_default_settings();
    const bool changed[GROUPS] = {false};
    tracked t = rest_of(model, &b);
    const vec3 before = b.point[PELVIS];
    pose_start(&s);
    t.has_position[LEFT_ANKLE] = true;
    t.position[LEFT_ANKLE] = along(b.point[LEFT_HIP], vec(0, 0, 1), 2);
    move_legs(&b, &t, &p, b.rotation, &settings, changed, &s);
    return (double)distance(b.point[PELVIS], before);
}

/* By how much (rad) joints of a predicted body are turned toward a wrist that is measured 10 cm higher. */
static double drawn(const bs_model *model, int joint) {
    static body b;
    static pose_state s;
    static prediction p;
    tracked t = rest_of(model, &b);
    memset(&s, 0, sizeof s);
    for (int j = 0; j < BODY_JOINTS; j++) p.rotation[j] = identity();
    p.head = b.point[HEAD];
    t.has_position[LEFT_WRIST] = true;
    t.accuracy[LEFT_WRIST] = 0.04F;
    t.position[LEFT_WRIST] = along(b.point[LEFT_WRIST], UP, 0.1F);
    fit_prediction(&t, &s, &p);
    return (double)length(turn_between(identity(), p.rotation[joint]));
}

static double fit_doubt(const bs_model *m) { return drawn(m, LEFT_ELBOW); }
static double gives_shoulder(const bs_model *m) { return drawn(m, LEFT_COLLAR); }
static double gives_trunk(const bs_model *m) { return drawn(m, SPINE3); }

/* ---- errors ------------------------------------------------------------------------------------------------------ */

/* By how much a bound is larger for a head at a height, of the standing one, and with a cosine of its tilt. */
static double larger_bound(const bs_model *model, double high, double upward) {
    static body b;
    static prediction p;
    static float finger[2 * HAND_POINTS], off[BS_POINTS], confidence[BS_POINTS], bound[2][BS_POINTS];
    for (int k = 0; k < BODY_POINTS; k++) p.error[k] = 0.05F;
    for (int j = 0; j < BODY_JOINTS; j++) p.unlike[j] = 0.05F;
    for (int k = 0; k < 2; k++) {
        tracked t = rest_of(model, &b);
        t.has_rotation[HEAD] = true;
        if (k) t.position[HEAD].y = t.floor + (float)high * standing_height(&t, HEAD);
        if (k) t.rotation[HEAD] = turned_by(identity(), vec(acosf((float)upward), 0, 0));
        expected_errors(model, &t, &p, finger, off, confidence, bound[k]);
    }
    return (double)(bound[1][PELVIS] / bound[0][PELVIS]) - 1.0;
}

static double bound_low_from(const bs_model *m) { return larger_bound(m, 0.65, 1); }
static double bound_low_more(const bs_model *m) { return larger_bound(m, 0.5, 1); }
static double bound_tilted_from(const bs_model *m) { return larger_bound(m, 1, 0.45); }
static double bound_tilted_more(const bs_model *m) { return larger_bound(m, 1, 0); }

/* By how many hundredths of its logarithm the test model's bound is larger if measured joints are some expected
 * distances from the predicted body. */
static double stranger_bound(const bs_model *model, double missed) {
    static body b;
    static prediction p;
    static float finger[2 * HAND_POINTS], off[BS_POINTS], confidence[BS_POINTS], bound[2][BS_POINTS];
    tracked t = rest_of(model, &b);
    t.has_position[LEFT_WRIST] = t.has_position[RIGHT_WRIST] = true;
    for (int k = 0; k < BODY_POINTS; k++) p.error[k] = 0.05F;
    for (int j = 0; j < BODY_JOINTS; j++) p.unlike[j] = 0.05F;
    for (int k = 0; k < 2; k++) {
        p.missed = k ? (float)missed : 0.0F;
        expected_errors(model, &t, &p, finger, off, confidence, bound[k]);
    }
    return 100.0 * log((double)(bound[1][PELVIS] / bound[0][PELVIS]));
}

static double missed_most(const bs_model *m) { return stranger_bound(m, 100); }

#endif
