/* Numbers of feet and steps. */
#ifndef BODYSENSE_TUNED_FEET_H
#define BODYSENSE_TUNED_FEET_H

#include "../src/limbs/feet.h"
#include "../src/limbs/steps.h"
#include "measure.h"

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
                           false, false, 0.0F, false, false, 0.0F};
    }
    s.body = (carrier){vec(0, 1.6F, 0), 1.0F, 0.0F, 0.0F};
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

/* How high a foot is lifted (m) whose ball has moved at a speed (m/s) for long. */
static float lifted_at(double speed) {
    foot_state s = {0};
    for (int k = 0; k < 100; k++) lift_moving(&s, vec((float)speed * TICK * (float)k, 0, 0), false, TICK);
    return s.lifted;
}

static double foot_lift(const bs_model *m) { (void)m; return (double)lifted_at(9); }
static double foot_moves(const bs_model *m) { (void)m; LEAST(0, 1, lifted_at(at) > 1e-6F); }

/* The lift (m) of a foot that is shown first with `lifted` (m), and has moved on by `step` (m) in each of some frames. */
static float lift_after(float lifted, float step, int frames) {
    foot_state s = {.shown = true, .lifted = lifted};
    for (int k = 1; k <= frames; k++) lift_moving(&s, vec(step * (float)k, 0, 0), false, TICK);
    return s.lifted;
}

static double foot_lag(const bs_model *m) { /* s until a foot that has jumped by 1 m is followed by half of that */
    foot_state s = {.shown = true};
    int frames = 0;
    (void)m;
    for (; s.ball.x < 0.499F && frames < FOREVER; frames++) lift_moving(&s, vec(1, 0, 0), false, TICK);
    return (double)frames * (double)TICK;
}

static double foot_rise(const bs_model *m) { (void)m; return (double)(lift_after(0, 9.0F * TICK, 2) / (2.0F * TICK)); }

static double foot_land(const bs_model *m) { /* s in which half of the lift is given up */
    int frames = 1;
    (void)m;
    while (lift_after(1.0F, 0, frames) > 0.501F && frames < FOREVER) frames++;
    return (double)frames * (double)TICK;
}

static double foot_descent(const bs_model *m) { /* a foot that is seen and eased, 2 mm from where it is measured */
    stand s = flat_feet(1);
    (void)m;
    s.upright = 1.0F;
    s.foot[0].seen = true;
    s.foot[0].away = 0.002F;
    for (int k = 0; k < 100; k++) shift(&s, 0, vec(TICK, 0, 0)), hold(&s, 1);
    return (double)(s.move[0].shift.y / s.foot[0].away);
}

/* How high a foot that is dragged is shown over the floor (m), under a head of a speed (m/s). */
static float shown_lift(double speed) {
    stand s = flat_feet(1);
    s.upright = 1.0F;
    s.foot[1].ankle_contact = s.foot[1].ball_contact = 0.2F;
    s.body.speed = (float)speed;
    for (int k = 0; k < 100; k++) shift(&s, 0, vec(TICK, 0, 0)), hold(&s, 1);
    return s.move[0].shift.y;
}

static double foot_calm(const bs_model *m) {
    const float most = shown_lift(0);
    (void)m;
    LEAST(0, 3, shown_lift(at) < 0.999F * most);
}
static double foot_walks(const bs_model *m) { (void)m; LEAST(0, 3, shown_lift(at) < 1e-5F); }

/* ---- steps ------------------------------------------------------------------------------------------------------- */

/* The strain after a second of a foot that is `off` from where it belongs while its body went `went` and turned. */
static float strain_of(double off, double went, double turn, double contact) {
    foot_state s = {.slide = vec(-(float)off, 0, 0), .turn = -(float)turn};
    float sine, cosine;
    sine_cosine((float)turn, &sine, &cosine);
    put_down(&s, (carrier){vec(0, 1.6F, 0), 1, 0, 0}, vec(0, 0, 0));
    strain_foot(&s, (carrier){vec((float)went, 1.6F, 0), cosine, sine, 0}, (float)contact, 1.0F, 0.0F);
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

/* How far a leg drags a foot before it steps (m), and 6 mm that the foot gives up: both follow the body at 0.4 m/s. */
static double step_dragged(const bs_model *m) {
    stand s = flat_feet(1);
    int frames = 0;
    (void)m;
    hold(&s, 100);
    for (; !steps(&s.state[0]) && frames < FOREVER; frames++) {
        shift(&s, 0, vec(0.4F * TICK, 0, 0));
        s.body.head.x += 0.4F * TICK;
        hold(&s, 1);
    }
    return 0.4 * (double)TICK * frames - foot_drag_standing(m);
}

static double step_strain(const bs_model *m) { (void)m; LEAST(0, 1, step_from(at, 0.1, 0).span > 0); }
static double step_span(const bs_model *m) { (void)m; return (double)step_from(9, 0.01, 0).span; }
static double step_speed(const bs_model *m) { (void)m; return 4.0 / (double)step_from(9, 4, 0).span; }
static double step_toe(const bs_model *m) { (void)m; return (double)step_from(9, 0, 20).span; }

static double step_lift(const bs_model *m) {
    foot_state s = {.step = step_from(9, 0.1, 0)};
    float most = 0.0F;
    (void)m;
    while (steps(&s)) most = fmaxf(most, advance_step(&s, TICK).lift);
    return (double)most;
}

static double step_rise(const bs_model *m) {
    foot_state s = {.slide = vec(4, 0, 0), .step = step_from(9, 4, 0)};
    (void)m;
    do advance_step(&s, TICK);
    while (s.slide.x > 3.999F);
    return (double)(s.step.age / step_from(9, 4, 0).span);
}

#endif
