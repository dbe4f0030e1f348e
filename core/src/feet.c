/* Feet that stand: held in place along the floor, and on the floor. */
#include "feet.h"
#include "maths.h"

static const float HOLD = 0.5F, RELEASE = 0.1F; /* probability of contact from which a foot is held, and let go */
static const float SURE = 0.7F;   /* probability of contact from which a foot is put on the floor entirely */
static const float FADE = 0.16F;  /* s in which half of what a released foot was held back by fades */
static const float DRAG = 0.04F;  /* m: a foot that its leg drags farther slides along */
static const float DRAG_STILL = 0.12F; /* m: so far, if both feet stand for a while */
static const float LEAK = 6.0F;   /* s in which half of what a standing foot is held back by is given up */
static const float SETTLE = 0.06F; /* s in which half of a foot's height over the floor is taken away */
static const float SOLE = 0.01F;  /* m: a foot that is over its rest height by less stands: recorded feet do */
static const float FLAT_FROM = 0.15F; /* s: a foot that stands on its heel for longer is flat on the floor */
static const float FLAT_UNTIL = 0.3F; /* probability of an ankle's contact until which it goes on to be flat */
static const float STILL = 0.6F;  /* of SOLE: what is left out for those who stand still */
static const float REACH = 0.25F; /* m: a foot is moved no farther up or down to the floor */

static float rest_height(const foot *f, int part) { return part == 1 ? f->ankle_rest : f->ball_rest; }
static vec3 place(const foot *f, int part) { return part == 1 ? f->ankle : f->ball; }

/* How far a part of a foot is too high to stand, or too low: below 0 (m). `sole` is how high it may be. */
static float too_high(float height, float rest, float floor, float sole) {
    float over = height - rest - floor;
    return over - clamp(over, 0.0F, sole);
}

/* How far the lower part of a foot is too high to stand (m). */
static float height_over(const foot *f, float floor, float sole) {
    return fminf(too_high(f->ankle.y, f->ankle_rest, floor, sole), too_high(f->ball.y, f->ball_rest, floor, sole));
}

float flatness(const foot_state *s) { return clamp((s->stood - FLAT_FROM) / FLAT_FROM, 0.0F, 1.0F); }

/* Which part holds now: the one that held stays as long as it may, then the surer one. */
static int holding(const foot *f, int before) {
    if (f->seen) return 0;
    if (before == 1 && f->ankle_contact >= RELEASE) return 1;
    if (before == 2 && f->ball_contact >= RELEASE) return 2;
    if (fmaxf(f->ankle_contact, f->ball_contact) < HOLD) return 0;
    return f->ankle_contact > f->ball_contact + 1e-5F ? 1 : 2;
}

void hold_feet(const foot foot[2], float floor, float interval, float upright, foot_state state[2], vec3 move[2]) {
    float fade = power_of_two(-interval / FADE), settle = 1.0F - power_of_two(-interval / SETTLE), leak = power_of_two(-interval / LEAK);
    /* Those who stand still on both feet stand lower, and do not step because the prediction sways. */
    float still = fminf(flatness(&state[0]), flatness(&state[1]));
    float sole = SOLE * (1.0F - STILL * still), drag = DRAG + (DRAG_STILL - DRAG) * still;
    float hovering = fmaxf(fminf(height_over(&foot[0], floor, sole), height_over(&foot[1], floor, sole)), 0.0F);
    int part[2];
    for (int k = 0; k < 2; k++) {
        part[k] = holding(&foot[k], state[k].held);
        if (foot[k].seen) hovering = 0.0F;
    }
    for (int k = 0; k < 2; k++) {
        const struct foot *f = &foot[k];
        foot_state *s = &state[k];
        vec3 slide = scale(s->slide, fade);
        float drop = 0.0F;
        if (part[k] != 0) {
            vec3 at = place(f, part[k]);
            if (part[k] == s->held) slide = scale(sub(s->anchor, at), leak);
            slide.y = 0.0F;
            float size = length(slide), most = fmaxf(drag, fade * length(s->slide));
            if (size > most) slide = scale(slide, most / size);
            s->anchor = add(at, slide);
            float contact = part[k] == 1 ? f->ankle_contact : f->ball_contact;
            drop = too_high(at.y, rest_height(f, part[k]), floor, sole);
            drop *= clamp((contact - RELEASE) / (SURE - RELEASE), 0.0F, 1.0F);
        }
        if (hovering > 0.0F) drop = fmaxf(drop, upright * hovering); /* nobody who stands hovers with both feet */
        if (!f->seen) drop = fmaxf(drop, f->kneels * fmaxf(height_over(f, floor, sole), 0.0F));
        bool rests = f->ankle_contact >= (s->stood > 0.0F ? FLAT_UNTIL : HOLD) && !f->seen;
        s->stood = rests ? s->stood + interval : 0.0F;
        s->held = (uint8_t)part[k];
        s->slide = slide;
        s->drop += settle * (clamp(drop, -REACH, REACH) - s->drop);
        move[k] = vec(0, 0, 0);
        if (f->seen) {
            s->slide = vec(0, 0, 0);
            s->drop = 0.0F;
            if (!f->met) move[k].y = clamp(floor - f->ankle.y, 0.0F, 2.0F * REACH); /* an ankle that is eased */
            continue;
        }
        move[k] = vec(slide.x, -s->drop, slide.z);
        float lowest = fminf(fminf(f->ankle.y, f->ball.y), f->toe.y) - s->drop - floor;
        if (lowest < 0.0F) move[k].y += fminf(-lowest, 2.0F * REACH); /* never under the floor */
    }
}
