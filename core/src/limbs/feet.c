/* Feet that stand: held in place along the floor, and on the floor. */
#include "feet.h"

#include "../base/kinematics.h"
#include "../base/maths.h"
#include "../constants.h"
#include "steps.h"

static float rest_height(const foot *f, int part) { return part == 1 ? f->ankle_rest : f->ball_rest; }

/* How far a part of a foot is too high to stand, or too low: below 0 (m). `sole` is how high it may be. */
static float too_high(float height, float rest, float floor, float sole) {
    float over = height - rest - floor;
    return over - clamp(over, 0.0F, sole);
}

/* How far the lower part of a foot is too high to stand (m). */
static float height_over(const foot *f, float floor, float sole) {
    return fminf(too_high(f->ankle.y, f->ankle_rest, floor, sole), too_high(f->ball.y, f->ball_rest, floor, sole));
}

float flatness(const foot_state *s) { return clamp((s->stood - FOOT_FLAT_FROM) / FOOT_FLAT_FROM, 0.0F, 1.0F); }

/* Which part holds now: the one that held stays as long as it may, then the surer one. */
static int holding(const foot *f, int before) {
    if (f->seen) return 0;
    if (before == 1 && f->ankle_contact >= FOOT_RELEASE) return 1;
    if (before == 2 && f->ball_contact >= FOOT_RELEASE) return 2;
    if (fmaxf(f->ankle_contact, f->ball_contact) < FOOT_HOLD) return 0;
    return f->ankle_contact > f->ball_contact + 1e-5F ? 1 : 2;
}

/* The rest of the offset of a foot that is no longer held, after a frame. */
static vec3 given_back(vec3 slide, float fade, float interval) {
    float size = length(slide);
    return size > 0.0F ? scale(slide, fmaxf(fade, 1.0F - FOOT_RETURN_SPEED * interval / size)) : slide;
}

/* Hold the turn of a foot that stands. `fresh`: it is put down now. */
static void hold_turn(const foot *f, foot_state *s, bool fresh, float leak, float most) {
    vec3 bone = sub(f->ball, f->ankle), level = vec(bone.x, 0, bone.z), now = unit(level), ahead = s->ahead;
    bool points = length(ahead) > 0.0F;
    s->ahead = vec(0, 0, 0);
    if (f->turned || length(level) < FOOT_LEVEL * length(bone)) return;
    if (!fresh && points) s->turn = leak * angle_of(now.z * ahead.x - now.x * ahead.z, dot(now, ahead));
    s->turn = clamp(s->turn, -most, most);
    float sine, cosine;
    sine_cosine(s->turn, &sine, &cosine);
    s->ahead = from_heading(now, cosine, sine);
}

/* The ball of a foot that is turned about its ankle. */
static vec3 turned_ball(const foot *f, float turn) {
    float sine, cosine;
    sine_cosine(turn, &sine, &cosine);
    return add(f->ankle, from_heading(sub(f->ball, f->ankle), cosine, sine));
}

void hold_feet(const foot foot[2], carrier body, float floor, float interval, float upright, foot_state state[2],
               foot_move move[2]) {
    float fade = power_of_two(-interval / FOOT_FADE), settle = 1.0F - power_of_two(-interval / FOOT_SETTLE);
    float leak = power_of_two(-interval / FOOT_LEAK), unturn = power_of_two(-interval / FOOT_TURN_LEAK);
    /* People who stand still on both feet stand lower, and their feet do not slide because the prediction sways. */
    float still = fminf(flatness(&state[0]), flatness(&state[1]));
    float sole = FOOT_SOLE * (1.0F - FOOT_STILL * still), drag = FOOT_DRAG + (FOOT_DRAG_STANDING - FOOT_DRAG) * still;
    float most_turn = FOOT_MOST_TURN * still;
    float calm = upright * clamp((FOOT_WALKS - body.speed) / (FOOT_WALKS - FOOT_CALM), 0.0F, 1.0F);
    float hovering = fmaxf(fminf(height_over(&foot[0], floor, sole), height_over(&foot[1], floor, sole)), 0.0F);
    int part[2];
    for (int k = 0; k < 2; k++) {
        part[k] = holding(&foot[k], state[k].held);
        if (foot[k].seen) hovering = 0.0F;
    }
    for (int k = 0; k < 2; k++) {
        const struct foot *f = &foot[k];
        foot_state *s = &state[k];
        bool fresh = part[k] == 0 || part[k] != s->held, stepping = steps(s) && !f->seen;
        vec3 before = s->slide;
        foot_flight flight = {0.0F, false};
        float drop = 0.0F, dragged = 0.0F;
        s->slide = given_back(s->slide, fade, interval);
        if (part[k] == 0 || fresh || f->turned) s->turn *= fade;
        if (stepping) flight = advance_step(s, interval);
        if (part[k] != 0) {
            float held_turn = fmaxf(most_turn, fade * fabsf(s->turn));
            hold_turn(f, s, fresh || flight.moves, stepping ? 1.0F : unturn, flight.moves ? fabsf(s->turn) : held_turn);
            vec3 at = part[k] == 1 ? f->ankle : turned_ball(f, s->turn);
            if (!flight.moves) {
                if (!fresh) s->slide = scale(sub(s->anchor, at), stepping ? 1.0F : leak);
                s->slide.y = 0.0F;
                vec3 whole = s->slide;
                s->slide = limited(whole, fmaxf(drag, length(given_back(before, fade, interval))));
                dragged = length(whole) - length(s->slide);
            }
            if (stepping && !flight.moves) s->step = (foot_step){s->slide, s->turn, s->step.age, s->step.span};
            s->anchor = add(at, s->slide);
            float contact = part[k] == 1 ? f->ankle_contact : f->ball_contact;
            if (fresh || stepping) put_down(s, body, s->anchor);
            else strain_foot(s, body, fmaxf(f->ankle_contact, f->ball_contact), interval, dragged);
            drop = too_high(at.y, rest_height(f, part[k]), floor, sole);
            drop *= clamp((contact - FOOT_RELEASE) / (FOOT_SURE - FOOT_RELEASE), 0.0F, 1.0F);
        } else s->strain = 0.0F;
        if (hovering > 0.0F) drop = fmaxf(drop, upright * hovering); /* a standing body has a foot on the floor */
        if (!f->seen) drop = fmaxf(drop, f->kneels * fmaxf(height_over(f, floor, sole), 0.0F));
        bool rests = (f->ankle_contact >= (s->stood > 0.0F ? FOOT_FLAT_UNTIL : FOOT_HOLD) || stepping) && !f->seen;
        s->stood = rests ? s->stood + interval : 0.0F;
        s->held = (uint8_t)part[k];
        s->drop += settle * (clamp(drop, -FOOT_REACH, FOOT_REACH) - s->drop);
        move[k] = (foot_move){{0, 0, 0}, 0.0F};
        if (f->seen) {
            s->slide = vec(0, 0, 0);
            s->turn = s->drop = s->step.span = 0.0F;
            float lift = fminf(calm * lift_moving(s, f->ball, f->met, interval), FOOT_DESCENT * f->away);
            float up = fmaxf(floor - f->ankle.y, lift - fmaxf(height_over(f, floor, 0.0F), 0.0F));
            if (!f->met) move[k].shift.y = clamp(up, 0.0F, 2.0F * FOOT_REACH);
            continue;
        }
        move[k] = (foot_move){vec(s->slide.x, -s->drop, s->slide.z), s->turn};
        float lowest = fminf(fminf(f->ankle.y, f->ball.y), f->toe.y) - s->drop - floor;
        if (lowest < 0.0F) move[k].shift.y += fminf(-lowest, 2.0F * FOOT_REACH); /* never under the floor */
        vec3 ball = add(turned_ball(f, s->turn), s->slide);
        float lift = fmaxf(flight.lift, calm * lift_moving(s, ball, f->driven, interval));
        move[k].shift.y += fmaxf(lift - fmaxf(height_over(f, floor, 0.0F) - s->drop, 0.0F), 0.0F);
    }
    begin_step(state);
}
