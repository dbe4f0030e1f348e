/* What each tuned number of constants.h does, measured: a row fails if its number is halved or doubled.
 *
 * A measure drives the part of the core that uses the number, without a network: the share of contact from which a foot
 * is held, the seconds in which an offset halves, the height of a step. */
#include "../src/body/fit.h"
#include "../src/body/head.h"
#include "../src/body/offset_decay.h"
#include "../src/body/trunk.h"
#include "../src/limbs/arms.h"
#include "../src/limbs/feet.h"
#include "../src/limbs/legs.h"
#include "../src/limbs/steps.h"
#include "../src/network/features.h"
#include "../src/network/network.h"
#include "../src/person/mounts.h"
#include "../src/person/person.h"
#include "../src/person/shape.h"
#include "../src/step/pose.h"

#define TICK 0.005F /* s between two frames of a measure */
#define FOREVER 60000

typedef double measure(const bs_model *model);

/* The least number of [low, high] for which a test holds that holds above it. */
#define LEAST(low, high, test)                                  \
    double from_ = (low), to_ = (high);                         \
    for (int round_ = 0; round_ < 40; round_++) {               \
        const double at = 0.5 * (from_ + to_);                  \
        if (test) to_ = at;                                     \
        else from_ = at;                                        \
    }                                                           \
    return to_

/* ---- feet -------------------------------------------------------------------------------------------------------- */

/* Two feet that stand flat under a body. */
typedef struct stand {
    foot foot[2];
    foot_state state[2];
    foot_move move[2];
    carrier body;
    float upright, floor;
} stand;

static stand flat_feet(float contact) {
    stand s;
    memset(&s, 0, sizeof s);
    for (int k = 0; k < 2; k++) {
        const float x = k ? -0.1F : 0.1F;
        s.foot[k] = (foot){vec(x, 0.08F, 0), vec(x, 0.02F, 0.14F), vec(x, 0.02F, 0.2F), 0.08F, 0.02F, contact, contact,
                           false, false, false, 0.0F};
    }
    s.body = (carrier){vec(0, 1.6F, 0), 1.0F, 0.0F};
    return s;
}

static void hold(stand *s, int frames) {
    for (int k = 0; k < frames; k++) hold_feet(s->foot, s->body, s->floor, TICK, s->upright, s->state, s->move);
}

static void shift(stand *s, int k, vec3 by) {
    s->foot[k].ankle = add(s->foot[k].ankle, by);
    s->foot[k].ball = add(s->foot[k].ball, by);
    s->foot[k].toe = add(s->foot[k].toe, by);
}

static void spin(stand *s, int k, float turn) {
    float sine, cosine;
    sine_cosine(turn, &sine, &cosine);
    s->foot[k].ball = add(s->foot[k].ankle, from_heading(sub(s->foot[k].ball, s->foot[k].ankle), cosine, sine));
}

static bool held_at(double contact, int before) {
    stand s = flat_feet((float)contact);
    s.state[0].held = (uint8_t)before;
    hold(&s, 1);
    return s.state[0].held != 0;
}

static double foot_hold(const bs_model *m) { (void)m; LEAST(0, 2, held_at(at, 0)); }
static double foot_release(const bs_model *m) { (void)m; LEAST(0, 2, held_at(at, 1)); }

/* The drop after a frame of a foot that is `over` too high (m), with a contact. */
static double drop_of(double over, double contact, float stood) {
    stand s = flat_feet((float)contact);
    for (int k = 0; k < 2; k++) shift(&s, k, vec(0, (float)over, 0)), s.state[k].stood = stood, s.state[k].held = 1;
    hold(&s, 1);
    return (double)s.state[0].drop;
}

static double foot_sure(const bs_model *m) {
    const double whole = drop_of(0.05, 3, 0);
    (void)m;
    LEAST(0, 2, drop_of(0.05, at, 0) > 0.9999 * whole);
}
static double foot_sole(const bs_model *m) { (void)m; LEAST(0, 0.1, drop_of(at, 1, 0) > 1e-6); }
static double foot_still(const bs_model *m) { (void)m; LEAST(0, 0.1, drop_of(at, 1, 9) > 1e-6); }

/* Seconds until a number of the state of the left foot is half of what it is. */
static double half_time(stand *s, const float *value) {
    const float most = fabsf(*value);
    int frames = 0;
    while (fabsf(*value) > 0.5F * most && frames < FOREVER) hold(s, 1), frames++;
    return (double)frames * (double)TICK;
}

static double foot_fade(const bs_model *m) {
    stand s = flat_feet(0);
    (void)m;
    s.state[0].slide.x = 0.02F;
    return half_time(&s, &s.state[0].slide.x);
}

static double foot_return_speed(const bs_model *m) {
    stand s = flat_feet(0);
    (void)m;
    s.state[0].slide.x = 1.0F;
    hold(&s, 1);
    return (double)((1.0F - s.state[0].slide.x) / TICK);
}

static bool points(double level) {
    stand s = flat_feet(1);
    s.foot[0].ball = add(s.foot[0].ankle, vec(0, -0.1F * sqrtf(1.0F - (float)(level * level)), 0.1F * (float)level));
    hold(&s, 1);
    return length(s.state[0].ahead) > 0.0F;
}

static double foot_level(const bs_model *m) { (void)m; LEAST(0, 1, points(at)); }

static double foot_leak(const bs_model *m) {
    stand s = flat_feet(1);
    (void)m;
    hold(&s, 1);
    shift(&s, 0, vec(0.02F, 0, 0));
    hold(&s, 1);
    return half_time(&s, &s.state[0].slide.x);
}

static double foot_settle(const bs_model *m) {
    stand s = flat_feet(0);
    (void)m;
    s.state[0].drop = 0.05F;
    return half_time(&s, &s.state[0].drop);
}

static bool is_flat(double stood) { return flatness(&(foot_state){.stood = (float)stood}) > 0.0F; }
static double foot_flat_from(const bs_model *m) { (void)m; LEAST(0, 2, is_flat(at)); }

static bool rests_at(double contact) {
    stand s = flat_feet((float)contact);
    s.state[0].stood = 1.0F;
    hold(&s, 1);
    return s.state[0].stood > 0.0F;
}

static double foot_flat_until(const bs_model *m) { (void)m; LEAST(0, 2, rests_at(at)); }

static double foot_reach(const bs_model *m) {
    stand s = flat_feet(1);
    (void)m;
    shift(&s, 0, vec(0, 1, 0));
    hold(&s, 400);
    return (double)s.state[0].drop;
}

/* How far a held foot is dragged by a leg that goes 1 m away (m), and turned by one that turns by 1.2 rad. */
static stand dragged(float other_contact, bool turns) {
    stand s = flat_feet(1);
    s.foot[1].ankle_contact = s.foot[1].ball_contact = other_contact;
    hold(&s, 100);
    if (turns) spin(&s, 0, 1.2F);
    else shift(&s, 0, vec(1, 0, 0));
    hold(&s, 1);
    return s;
}

static double foot_drag(const bs_model *m) { (void)m; return (double)length(dragged(0, false).state[0].slide); }
static double foot_drag_standing(const bs_model *m) {
    (void)m;
    return (double)length(dragged(1, false).state[0].slide);
}
static double foot_most_turn(const bs_model *m) { (void)m; return (double)fabsf(dragged(1, true).state[0].turn); }

static double foot_turn_leak(const bs_model *m) {
    stand s = flat_feet(1);
    (void)m;
    hold(&s, 100);
    spin(&s, 0, 0.2F);
    hold(&s, 1);
    return half_time(&s, &s.state[0].turn);
}

/* ---- steps ------------------------------------------------------------------------------------------------------- */

/* The strain after a second of a foot that is `off` from where it belongs while its body went `went` and turned. */
static float strain_of(double off, double went, double turn, double contact) {
    foot_state s = {.slide = vec(-(float)off, 0, 0), .turn = -(float)turn};
    float sine, cosine;
    sine_cosine((float)turn, &sine, &cosine);
    put_down(&s, (carrier){vec(0, 1.6F, 0), 1, 0}, vec(0, 0, 0));
    strain_foot(&s, (carrier){vec((float)went, 1.6F, 0), cosine, sine}, (float)contact, 1.0F);
    return s.strain;
}

static double sway_and_least(void) { LEAST(0, 1, strain_of(9, at, 0, 0) > 0); }
static double step_least(const bs_model *m) { (void)m; LEAST(0, 1, strain_of(at, 9, 0, 0) > 0); }
static double step_least_sure(const bs_model *m) { (void)m; LEAST(0, 1, strain_of(at, 9, 0, 2) > 0); }
static double step_sway(const bs_model *m) { return sway_and_least() - step_least(m); }
static double step_loose(const bs_model *m) { (void)m; LEAST(0, 3, strain_of(0.0416, 9, 0, at) <= 0); }
static double step_sure(const bs_model *m) { (void)m; LEAST(0, 3, strain_of(0.1184, 9, 0, at) <= 0); }
static double step_radius(const bs_model *m) { (void)m; LEAST(0, 1, strain_of(0, 0, at, 0) > 0); }

/* A step of a foot that is `off` (m) and turned (rad) from where it belongs; a span of 0: none. */
static foot_step step_from(double strain, double off, double turn) {
    foot_state s[2] = {{.strain = (float)strain, .slide = vec((float)off, 0, 0), .turn = (float)turn}, {.held = 1}};
    begin_step(s);
    return s[0].step;
}

static double step_strain(const bs_model *m) { (void)m; LEAST(0, 1, step_from(at, 0.1, 0).span > 0); }
static double step_span(const bs_model *m) { (void)m; return (double)step_from(9, 0.01, 0).span; }
static double step_speed(const bs_model *m) { (void)m; return 4.0 / (double)step_from(9, 4, 0).span; }
static double step_toe(const bs_model *m) { (void)m; return (double)step_from(9, 0, 20).span; }

static double step_lift(const bs_model *m) {
    foot_state s = {.step = step_from(9, 0.1, 0)};
    float most = 0.0F;
    (void)m;
    while (steps(&s)) most = fmaxf(most, advance_step(&s, TICK));
    return (double)most;
}

static double step_rise(const bs_model *m) {
    foot_state s = {.step = step_from(9, 4, 0)};
    (void)m;
    do advance_step(&s, TICK);
    while (s.slide.x > 3.999F);
    return (double)(s.step.age / step_from(9, 4, 0).span);
}

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

/* ---- persons ----------------------------------------------------------------------------------------------------- */

static bool accepts(double height) {
    bs_person person = {.height = height, .height_deviation = 0.01};
    for (int p = 1; p < BS_POINTS; p++) person.rest_offset[p][1] = p == SPINE1 ? 0.5 : -0.1;
    return check_person(&person) == BS_OK;
}

static double person_shortest(const bs_model *m) { (void)m; LEAST(0, 1.5, accepts(at)); }
static double person_tallest(const bs_model *m) { (void)m; LEAST(1.5, 9, !accepts(at)); }

/* Speed (m/s) at which the stature in use nears one that is `more` larger (m), of a wearer who moves. */
static double growth(const bs_model *model, double more, double speed, double known) {
    static proportions own;
    static tracked t;
    bs_person person = {.height = 1.7, .height_deviation = 0.01};
    if (bs_person_likeliest(model, &person) != BS_OK) exit(1);
    person.height = known;
    proportions_start(&person, &own);
    const double before = rest_height(own.current, HEAD_TOP);
    for (int p = 0; p < BS_POINTS; p++)
        for (int c = 0; c < 3; c++) own.believed[p][c] *= 1 + more / before;
    own.elapsed = 1.0;
    own.speed = speed;
    t.interval = TICK;
    proportions_step(model, &person, &t, (double)TICK, &own);
    return (rest_height(own.current, HEAD_TOP) - before) / (double)TICK;
}

static double growth_still(const bs_model *m) { return growth(m, 1, 0, (double)NAN); }
static double growth_moving(const bs_model *m) { return growth(m, 1, 9, (double)NAN); }
static double growth_moves(const bs_model *m) { LEAST(0, 3, growth(m, 1, at, (double)NAN) > 0.05); }
static double body_half_life(const bs_model *m) { return 0.004 * log(2) / growth(m, 0.004, 0, (double)NAN); }

/* Look at a head that was at `been` and is `ahead` of it (m), `over` its height at rest (m). */
static proportions looked_at(const bs_model *model, double ahead, double over) {
    static proportions own;
    static tracked t;
    bs_person person = {.height = 1.7, .height_deviation = 0.01};
    if (bs_person_likeliest(model, &person) != BS_OK) exit(1);
    proportions_start(&person, &own);
    own.head[0] = own.head[1] = own.head[2] = 0.0;
    own.elapsed = 1.0;
    t.has_position[HEAD] = true;
    t.position[HEAD] = vec((float)ahead, (float)(rest_height(own.believed, HEAD) + over), 0);
    t.accuracy[HEAD] = 0.001F;
    proportions_step(model, &person, &t, 0.1, &own);
    return own;
}

static double walk_ahead(const bs_model *m) { LEAST(0, 3, looked_at(m, at, 0).walked > 0); }
static double walk_farthest(const bs_model *m) { LEAST(3, 20, looked_at(m, at, 0).walked <= 0); }
static double walk_lag(const bs_model *m) { return looked_at(m, 1, 0).been[0]; }
static double height_tiptoe(const bs_model *m) { LEAST(0, 1, looked_at(m, 0, at).contradicting > 0); }

static bool is_released(const bs_model *model, double seconds) {
    proportions own;
    static tracked t;
    bs_person person = {.height = 1.7, .height_deviation = 0.01};
    if (bs_person_likeliest(model, &person) != BS_OK) exit(1);
    own = looked_at(model, 0, 0.3);
    own.contradicting = seconds;
    t.has_position[HEAD] = true;
    t.position[HEAD] = vec(0, (float)(rest_height(own.believed, HEAD) + 0.3), 0);
    t.accuracy[HEAD] = 0.001F;
    proportions_step(model, &person, &t, 0.1, &own);
    return own.released;
}

static double height_contradicted(const bs_model *m) { LEAST(0, 10, is_released(m, at)); }

static double mount_half_life(const bs_model *m) {
    static mounts own;
    static tracked t;
    static bs_person person;
    int frames = 0;
    (void)m;
    memset(&own, 0, sizeof own);
    person.mount[LEFT_KNEE].worn = 1;
    own.mean[3] = 0.02;
    do mounts_step(&person, 0.01, &own, &t);
    while (++frames < FOREVER && own.correction[1][0] < 0.01);
    return frames * 0.01;
}

static double mount_interval(const bs_model *m) {
    static mounts own;
    static tracked t;
    static bs_person person;
    int frames = 0;
    (void)m;
    memset(&own, 0, sizeof own);
    person.mount[LEFT_KNEE].worn = 1;
    do mounts_step(&person, 0.001, &own, &t);
    while (++frames < FOREVER && own.due > 0);
    return frames * 0.001;
}

/* ---- inputs and features ----------------------------------------------------------------------------------------- */

/* The result of a frame with a head alone, and how far it is expected to be off (m). */
static bs_result one_frame(const bs_model *model, const bs_settings *settings, double x, double size, double accuracy,
                           double *expected) {
    static double root[3], rotation[BS_JOINTS][4], points[BS_POINTS][3], confidence[BS_POINTS], bound[BS_POINTS];
    static double contact[BS_CONTACTS], rest_offset[BS_POINTS][3];
    static uint8_t measured[BS_POINTS];
    const int32_t point = HEAD;
    const uint8_t yes = 1;
    const double time = 0, position[3] = {x, 1.6, 0}, q[4] = {size, 0, 0, 0};
    const bs_observation seen = {1, 1, &point, &time, position, q, &yes, &yes, &accuracy, NULL};
    const bs_estimate out = {root, rotation[0], points[0], measured, confidence, bound, contact, rest_offset[0]};
    bs_person person = {.height = 1.7, .height_deviation = 0.01};
    bs_state *state;
    int refused;
    const size_t bytes = bs_state_size(model), scratch_bytes = bs_scratch_size(model, 1);
    void *memory = aligned_alloc(64, (bytes + 63) / 64 * 64), *scratch = aligned_alloc(64, (scratch_bytes + 63) / 64 * 64);
    if (!memory || !scratch || bs_person_likeliest(model, &person) != BS_OK ||
        bs_state_start(model, &person, memory, bytes, &state) != BS_OK)
        exit(1);
    const bs_result done = bs_step(model, settings, 1, &seen, &state, &out, scratch, scratch_bytes, &refused);
    if (expected) *expected = confidence[HEAD];
    free(scratch);
    free(memory);
    return done;
}

static bool refuses(const bs_model *model, double x, double size) {
    const bs_settings settings = bs_default_settings();
    return one_frame(model, &settings, x, size, 0.001, NULL) != BS_OK;
}

static double input_farthest(const bs_model *m) { LEAST(0, 9000, refuses(m, at, 1)); }
static double input_unit(const bs_model *m) { LEAST(0, 1, refuses(m, 0, 1 + at)); }

static double expected_for(const bs_model *model, double accuracy) {
    const bs_settings settings = bs_default_settings();
    double expected = 0;
    one_frame(model, &settings, 0, 1, accuracy, &expected);
    return expected;
}

static double input_finest(const bs_model *m) { return expected_for(m, 1e-7); }
static double input_coarsest(const bs_model *m) { return expected_for(m, 1e7); }

static bool takes(const bs_model *model, double ease, double first, double longest) {
    bs_settings settings = bs_default_settings();
    settings.ease = ease;
    settings.first = first;
    settings.longest = longest;
    return one_frame(model, &settings, 0, 1, 0.001, NULL) == BS_OK;
}

static double longest_ease(const bs_model *m) { LEAST(1, 90, !takes(m, at, 0.03, 0.1)); }
static double shortest_interval(const bs_model *m) { LEAST(0, 0.1, takes(m, 0, at, 0.1)); }
static double longest_interval(const bs_model *m) { LEAST(1, 90, !takes(m, 0, 0.03, at)); }

/* A feature of a head that is 100 m away, was 1 m from there, spins, and is accurate to 1 nm. */
static double feature(const bs_model *model, size_t place) {
    static float out[FEATURES_ACCELERATION + 64];
    static body b;
    static input_memory last;
    tracked t = rest_of(model, &b);
    const int head = 15; /* of `BODY_POINT` */
    memset(&last, 0, sizeof last);
    t.position[HEAD] = vec(100, 0, 0);
    t.has_rotation[HEAD] = true;
    t.accuracy[HEAD] = 1e-9F;
    t.deviation[HEAD] = 0.05F;
    last.cosine = last.had_axes[0] = 1.0F;
    last.had_place[head] = 1.0F;
    last.axis[0][0] = vec(9, 9, 9);
    const reading read = read_person(&t, &last);
    write_features(model, &t, &read, (head_frame){vec(0, 0, 0), 1, 0}, &last, false, out);
    const size_t start = place == 2 ? 8 * READ_POINTS + 7 * BODY_JOINTS : place * READ_POINTS + 3 * (size_t)head;
    if (place == 3) return (double)out[7 * READ_POINTS + head];
    if (place == 2) return (double)fabsf(out[start]);
    return sqrt((double)(out[start] * out[start] + out[start + 1] * out[start + 1] + out[start + 2] * out[start + 2]));
}

static double feature_reach(const bs_model *m) { return feature(m, 0); }
static double feature_fastest(const bs_model *m) { return feature(m, 4); }
static double feature_swiftest(const bs_model *m) { return feature(m, 0) - feature(m, 2); } /* as REACH is near */
static double feature_finest(const bs_model *m) { return feature(m, 3); }

static double reference_head(const bs_model *model) {
    static body b;
    const tracked t = rest_of(model, &b);
    return (double)(standing_height(&t, HEAD) / stature(t.rest_offset));
}

static double normal_bound(const bs_model *model) {
    static body b;
    static prediction p;
    static float finger[2 * HAND_POINTS], off[BS_POINTS], confidence[BS_POINTS], bound[BS_POINTS];
    tracked t = rest_of(model, &b);
    for (int k = 0; k < BODY_POINTS; k++) p.error[k] = 0.05F;
    for (int j = 0; j < BODY_JOINTS; j++) p.unlike[j] = 0.05F;
    t.accuracy[HEAD] = 0.01F;
    expected_errors(model, &t, &p, finger, off, confidence, bound);
    return (double)(bound[HEAD] / confidence[HEAD]);
}

/* ---- lengths ----------------------------------------------------------------------------------------------------- */

/* Look at a thigh of 40 cm for `frames` of `interval` s; its ends err by `accuracy` together (m). */
static proportions measured_thigh(const bs_model *model, int frames, double interval, double accuracy) {
    static proportions own;
    static tracked t;
    bs_person person = {.height = (double)NAN, .height_deviation = 0.01};
    if (bs_person_likeliest(model, &person) != BS_OK) exit(1);
    proportions_start(&person, &own);
    own.elapsed = 1.0;
    t.has_position[LEFT_HIP] = t.has_position[LEFT_KNEE] = true;
    t.position[LEFT_KNEE] = vec(0, 0.4012F, 0);
    t.accuracy[LEFT_HIP] = t.accuracy[LEFT_KNEE] = 0.5F * (float)accuracy;
    for (int k = 0; k < frames; k++) proportions_step(model, &person, &t, interval, &own);
    return own;
}

static double counted(proportions own) {
    double sum = 0;
    for (int b = 0; b < BINS; b++) sum += (double)own.seconds[4][b];
    return sum;
}

static double length_vague(const bs_model *m) { LEAST(0, 1, counted(measured_thigh(m, 1, 0.2, at)) == 0); }
static double length_interval(const bs_model *m) { LEAST(0, 1, counted(measured_thigh(m, 1, at, 0.01)) > 0); }
static double body_interval(const bs_model *m) { LEAST(0.11, 2, measured_thigh(m, 1, at, 0.01).due == 0); }

static double length_bin(const bs_model *m) {
    const proportions own = measured_thigh(m, 1, 0.2, 0.01);
    int bin = 0;
    while (bin < BINS - 1 && own.seconds[4][bin] == 0) bin++;
    return 0.4012 / (bin + 0.5);
}

/* ---- more mounts ------------------------------------------------------------------------------------------------- */

/* The mounts after a leg was `excess` (m) longer than its bones: between pelvis and knee, or ankle. `unsure` are the
 * variances (m²) of a bone and of the pelvis's place. */
static mounts strapped(double excess, bool ankle, double unsure_bone, double unsure_place) {
    static mounts own;
    static tracked t;
    static bs_person person;
    const int end = ankle ? LEFT_ANKLE : LEFT_KNEE;
    memset(&own, 0, sizeof own);
    memset(&t, 0, sizeof t);
    memset(&person, 0, sizeof person);
    person.mount[PELVIS].worn = person.mount[end].worn = 1;
    for (int k = 0; k < LIMB_BONES; k++) {
        own.mean[3 * REFINED_JOINTS + k] = 0.4;
        own.covariance[3 * REFINED_JOINTS + k][3 * REFINED_JOINTS + k] = unsure_bone;
    }
    own.covariance[1][1] = unsure_place;
    t.has_position[PELVIS] = t.has_rotation[PELVIS] = t.has_position[end] = t.has_rotation[end] = true;
    t.rotation[PELVIS] = t.rotation[end] = identity();
    t.position[end] = vec(0, -(float)((ankle ? 0.8 : 0.4) + excess), 0);
    mounts_step(&person, 0.2, &own, &t);
    return own;
}

static double thigh_change(mounts own) { return fabs(own.mean[3 * REFINED_JOINTS] - 0.4); }
static double mount_farthest(const bs_model *m) { (void)m; LEAST(0, 1, thigh_change(strapped(at, false, 1e-8, 0)) == 0); }
static double mount_most(const bs_model *m) { (void)m; LEAST(0, 1, strapped(at, false, 0, 1).mean[1] == 0); }
static double mount_bent(const bs_model *m) { (void)m; LEAST(0, 1, thigh_change(strapped(-at, true, 1e-8, 0)) == 0); }

static double mount_short_noise(const bs_model *m) {
    (void)m;
    return sqrt(1e-6 * 0.005 / thigh_change(strapped(-0.005, true, 1e-6, 0)));
}

static double mount_slip(const bs_model *m) {
    (void)m;
    return sqrt(strapped(9, false, 1e-12, 0).covariance[3 * REFINED_JOINTS][3 * REFINED_JOINTS] / 0.2);
}

static double mount_bone_least(const bs_model *m) {
    static mounts own;
    static bs_person person;
    (void)m;
    mounts_start(&person, &own);
    return sqrt(own.covariance[3 * REFINED_JOINTS][3 * REFINED_JOINTS]);
}

/* ---- the table --------------------------------------------------------------------------------------------------- */

static const struct tuned {
    const char *name; /* one number, or several that one measure holds */
    double value;     /* as measured: a threshold itself, else what follows from it */
    measure *measured;
} TUNED[] = {
    {"FOOT_HOLD", 0.5, foot_hold},
    {"FOOT_RELEASE", 0.1, foot_release},
    {"FOOT_SURE", 0.7, foot_sure},
    {"FOOT_SOLE", 0.01, foot_sole},
    {"FOOT_STILL", 0.004, foot_still},
    {"FOOT_FADE", 0.16, foot_fade},
    {"FOOT_RETURN_SPEED", 0.5, foot_return_speed},
    {"FOOT_LEVEL", 0.3, foot_level},
    {"FOOT_LEAK", 6, foot_leak},
    {"FOOT_SETTLE", 0.06, foot_settle},
    {"FOOT_FLAT_FROM", 0.15, foot_flat_from},
    {"FOOT_FLAT_UNTIL", 0.3, foot_flat_until},
    {"FOOT_REACH", 0.25, foot_reach},
    {"FOOT_DRAG", 0.04, foot_drag},
    {"FOOT_DRAG_STANDING", 0.13, foot_drag_standing},
    {"FOOT_MOST_TURN", 0.35, foot_most_turn},
    {"FOOT_TURN_LEAK", 1, foot_turn_leak},
    {"STEP_LEAST", 0.04, step_least},
    {"STEP_LEAST_SURE", 0.12, step_least_sure},
    {"STEP_SWAY", 0.06, step_sway},
    {"STEP_LOOSE", 0.312, step_loose},
    {"STEP_SURE", 0.888, step_sure},
    {"STEP_RADIUS", 0.267, step_radius},
    {"STEP_STRAIN", 0.03, step_strain},
    {"STEP_SPAN", 0.35, step_span},
    {"STEP_SPEED", 0.4, step_speed},
    {"STEP_TOE", 10, step_toe},
    {"STEP_LIFT", 0.035, step_lift},
    {"STEP_RISE", 0.207, step_rise},
    {"EASE_RAMP", 0.125, ease_ramp},
    {"EASE_FASTEST", 12.5, ease_fastest},
    {"OFFSET_HALF_LIFE", 0.1, offset_half_life},
    {"OFFSET_TRUSTED", 0.7, offset_trusted},
    {"OFFSET_CARRIED", 0.5, offset_carried},
    {"BLEND", 0.25, blend},
    {"ARM_STEEPEST", 3, arm_steepest},
    {"LOST_LEG", 0.12, lost_leg},
    {"LOST_ARM", 0.35, lost_arm},
    {"LOST_RAISED", 3, lost_raised},
    {"LOST_LOW", 1, lost_low},
    {"LOST_LEAVING", 0.077, lost_leaving},
    {"RAISED_FROM RAISED_SPAN", 1.01, raised_from},
    {"LOW_HAND LOW_HAND_SPAN", 0.675, low_hand},
    {"LOW_HAND_SPEED", 0.567, low_hand_speed},
    {"HEAD_STIRRED", 0.5, head_stirred},
    {"HEAD_CALM", 0.1, head_calm},
    {"ARM_BENT", 0.03, arm_bent},
    {"LEG_BENT", 0.1, leg_bent},
    {"KNEE_HINGE", 2, knee_hinge},
    {"LIMB_STRAIGHT", 0.9995, limb_straight},
    {"HINGE_FROM HINGE_FULL", 0.2, hinge_from},
    {"HINGE_UPRIGHT HINGE_TILTED", 0.201, hinge_upright},
    {"HINGE_RATE", 30, hinge_rate},
    {"HINGE_MOST", 300, hinge_most},
    {"COLLAR_DOUBT", 0.5, collar_doubt},
    {"COLLAR_GIVES", 0.675, collar_gives},
    {"WRIST_KEPT", 16.8, wrist_kept},
    {"COURSE_SPEED", 0.4, course_speed},
    {"COURSE_HALF_LIFE", 0.5, course_half_life},
    {"FIT_FADE", 0.25, fit_fade},
    {"HEAD_LOW HEAD_SEATED", 0.5, head_low},
    {"PELVIS_LOW PELVIS_BOWS", 0.5, pelvis_low},
    {"HEAD_STRETCHED", 0.5, head_stretched},
    {"HEAD_STEADY", 0.571, head_steady},
    {"HEAD_FALLING", 0.5, head_falling},
    {"HEAD_OVER", 0.03, head_over},
    {"KNEE_DOWN KNEE_UP", 0.00205, knee_down},
    {"PELVIS_SETTLE", 0.06, pelvis_settle},
    {"PELVIS_MOST_SHIFT", 0.15, pelvis_most_shift},
    {"BOUND_LOW_FROM BOUND_LOW_AT", 0.25, bound_low_from},
    {"BOUND_LOW_MORE", 0.5, bound_low_more},
    {"BOUND_TILTED_FROM", 0.4, bound_tilted_from},
    {"BOUND_TILTED_MORE", 0.8, bound_tilted_more},
    {"PERSON_SHORTEST", 1, person_shortest},
    {"PERSON_TALLEST", 2.3, person_tallest},
    {"GROWTH_STILL", 0.02, growth_still},
    {"GROWTH_MOVING", 0.1, growth_moving},
    {"GROWTH_MOVES", 0.2, growth_moves},
    {"BODY_HALF_LIFE", 0.4, body_half_life},
    {"WALK_AHEAD", 0.667, walk_ahead},
    {"WALK_FARTHEST", 4.44, walk_farthest},
    {"WALK_LAG", 0.1, walk_lag},
    {"HEIGHT_TIPTOE", 0.08, height_tiptoe},
    {"HEIGHT_CONTRADICTED", 1.9, height_contradicted},
    {"MOUNT_HALF_LIFE", 2, mount_half_life},
    {"MOUNT_INTERVAL", 0.1, mount_interval},
    {"INPUT_FARTHEST", 1000, input_farthest},
    {"INPUT_UNIT", 0.01, input_unit},
    {"INPUT_FINEST", 1e-4, input_finest},
    {"INPUT_COARSEST", 1000, input_coarsest},
    {"SETTING_LONGEST_EASE", 10, longest_ease},
    {"SETTING_SHORTEST_INTERVAL", 1e-4, shortest_interval},
    {"SETTING_LONGEST_INTERVAL", 10, longest_interval},
    {"FEATURE_REACH", 16, feature_reach},
    {"FEATURE_FASTEST", 5, feature_fastest},
    {"FEATURE_SWIFTEST", 1, feature_swiftest},
    {"FEATURE_FINEST", -1, feature_finest},
    {"REFERENCE_HEAD", 1.5, reference_head},
    {"NORMAL_BOUND", 1.567, normal_bound},
    {"LENGTH_VAGUE", 0.06, length_vague},
    {"LENGTH_INTERVAL", 0.1, length_interval},
    {"LENGTH_BIN", 0.005, length_bin},
    {"BODY_INTERVAL", 0.5, body_interval},
    {"MOUNT_NOISE MOUNT_FARTHEST", 0.04, mount_farthest},
    {"MOUNT_MOST", 0.05, mount_most},
    {"MOUNT_BENT", 0.01, mount_bent},
    {"MOUNT_SHORT_NOISE", 0.1, mount_short_noise},
    {"MOUNT_SLIP", 1e-4, mount_slip},
    {"MOUNT_BONE_LEAST", 0.001, mount_bone_least},
};
