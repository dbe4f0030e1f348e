/* Steps: see steps.h. */
#include "steps.h"

#include "../base/kinematics.h"
#include "../base/maths.h"
#include "../constants.h"

void put_down(foot_state *s, carrier body, vec3 anchor) {
    s->put_at = anchor;
    s->put_by = body;
    s->strain = 0.0F;
}

/* How far (m) the body's motion since the foot was put down would have carried it along `direction`, from the anchor. */
static float carried(const foot_state *s, carrier body, vec3 direction) {
    vec3 from = into_heading(sub(s->put_at, s->put_by.head), s->put_by.cosine, s->put_by.sine);
    vec3 now = add(body.head, from_heading(from, body.cosine, body.sine));
    return fmaxf(dot(sub(now, s->anchor), direction), 0.0F);
}

/* How far (rad) the pelvis has turned since the foot was put down, against the turn that holds it. */
static float turned_away(const foot_state *s, carrier body) {
    float sine = body.sine * s->put_by.cosine - body.cosine * s->put_by.sine;
    float angle = angle_of(sine, body.cosine * s->put_by.cosine + body.sine * s->put_by.sine);
    return fmaxf(s->turn < 0.0F ? angle : -angle, 0.0F);
}

void strain_foot(foot_state *s, carrier body, float contact, float interval, float dragged) {
    float off = length(s->slide), sure = clamp((contact - STEP_LOOSE) / (STEP_SURE - STEP_LOOSE), 0.0F, 1.0F);
    float confirmed = carried(s, body, scale(unit(s->slide), -1.0F)) - STEP_SWAY;
    float apart = fminf(off, fmaxf(confirmed, 0.0F));
    float twisted = STEP_RADIUS * fminf(fabsf(s->turn), turned_away(s, body));
    float least = STEP_LEAST + (STEP_LEAST_SURE - STEP_LEAST) * sure;
    s->strain = fmaxf(s->strain + interval * (sqrtf(apart * apart + twisted * twisted) - least), 0.0F);
    if (confirmed > 0.0F) s->strain += STEP_DRAGGED * dragged;
}

void begin_step(foot_state state[2]) {
    foot_state *s = &state[state[1].strain > state[0].strain], *other = &state[s == state];
    if (steps(&state[0]) || steps(&state[1]) || s->strain < STEP_STRAIN || other->held == 0) return;
    float way = length(s->slide) + STEP_TOE * fabsf(s->turn);
    s->step = (foot_step){.from = s->slide, .turned = s->turn, .span = fmaxf(STEP_SPAN, way / STEP_SPEED)};
    s->strain = 0.0F;
}

/* How far a step of an age (s) is along the floor, 0 to 1: a foot that rises or lands stays where it is. */
static float along_floor(const foot_step *step, float age) {
    return clamp((age / step->span - STEP_RISE) / (1.0F - 2.0F * STEP_RISE), 0.0F, 1.0F);
}

foot_flight advance_step(foot_state *s, float interval) {
    float before = along_floor(&s->step, s->step.age);
    s->step.age += interval;
    float u = fminf(s->step.age / s->step.span, 1.0F), v = along_floor(&s->step, s->step.age);
    float left = 1.0F - v * v * (3.0F - 2.0F * v), up = 4.0F * u * (1.0F - u);
    foot_flight flight = {.lift = STEP_LIFT * up * up, .moves = v > 0.0F && before < 1.0F};
    if (flight.moves) {
        s->slide = scale(s->step.from, left);
        s->turn = left * s->step.turned;
    }
    if (u >= 1.0F) s->step.span = 0.0F;
    return flight;
}

float lift_moving(foot_state *s, vec3 ball, bool driven, float interval) {
    float followed = s->shown ? 1.0F - power_of_two(-interval / FOOT_LAG) : 1.0F;
    vec3 moved = scale(sub(ball, s->ball), followed);
    float speed = s->shown && !driven ? length(vec(moved.x, 0.0F, moved.z)) / interval : 0.0F;
    float lifted = FOOT_LIFT * clamp(speed / FOOT_MOVES - 1.0F, 0.0F, 1.0F);
    float landed = s->lifted + (lifted - s->lifted) * (1.0F - power_of_two(-interval / FOOT_LAND));
    s->lifted = lifted > s->lifted ? fminf(lifted, s->lifted + interval * FOOT_RISE) : landed;
    s->ball = add(s->ball, moved);
    s->shown = true;
    return s->lifted;
}
