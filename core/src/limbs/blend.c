/* Blending a limb at a time: see blend.h. */
#include "blend.h"

#include "../base/maths.h"
#include "../constants.h"

/* The group of each joint of the body. */
const signed char JOINT_GROUP[BODY_JOINTS] = {
    TRUNK, LEFT_LEG, RIGHT_LEG, TRUNK, LEFT_LEG, RIGHT_LEG, TRUNK, LEFT_LEG, RIGHT_LEG, TRUNK, LEFT_LEG, RIGHT_LEG,
    TRUNK, TRUNK, TRUNK, TRUNK, LEFT_ARM, RIGHT_ARM, LEFT_ARM, RIGHT_ARM, LEFT_ARM, RIGHT_ARM,
};

void find_changes(const tracked *t, const pose_state *s, bool changed[GROUPS]) {
    for (int g = 0; g < GROUPS; g++) changed[g] = false;
    if (!s->begun) return;
    for (int j = 0; j < BODY_JOINTS; j++) {
        bool came = t->has_position[j] != (s->had_position[j] != 0);
        bool turned = known_rotation(t, j) != (s->had_rotation[j] != 0) && j != LEFT_WRIST && j != RIGHT_WRIST;
        if (came || turned) changed[JOINT_GROUP[j]] = true;
    }
    if (t->has_position[LEFT_TOE] != (s->had_position[LEFT_TOE] != 0)) changed[LEFT_LEG] = true;
    if (t->has_position[RIGHT_TOE] != (s->had_position[RIGHT_TOE] != 0)) changed[RIGHT_LEG] = true;
    if (t->has_position[HEAD_TOP] != (s->had_position[HEAD_TOP] != 0)) changed[TRUNK] = true;
    if (changed[TRUNK])
        for (int k = 0; k < LIMBS; k++) changed[k] = true;
}

void limb_heading(const body *b, int limb, float *c, float *s) {
    heading_of(b->rotation[is_leg(limb) ? PELVIS : SPINE3], c, s);
}

static uint8_t seen_by(const tracked *t, int limb) {
    return t->has_position[LIMB[limb].end] ? 2 : t->stands_in[limb];
}

/* Let a lost end wane for a frame. Returns the share that is left of where it was last seen. */
static float kept_share(const limb_task *task, const tracked *t, int limb, limb_state *l) {
    float height = l->end_kept.y / (length(task->upper) + length(task->lower));
    float raised = is_leg(limb) ? 0.0F : fminf(fmaxf((height - RAISED_FROM) / RAISED_SPAN, 0.0F), 1.0F);
    float low = fminf(fmaxf((LOW_HAND - height) / LOW_HAND_SPAN, 0.0F), 1.0F);
    float rests = is_leg(limb) ? 0.0F : low * fmaxf(1.0F - length(l->end_leaving) / LOW_HAND_SPEED, 0.0F);
    float half = is_leg(limb) ? LOST_LEG : LOST_ARM + (LOST_RAISED - LOST_ARM) * raised + (LOST_LOW - LOST_ARM) * rests;
    l->waned += t->interval + (t->waning - t->interval) * fmaxf(raised, rests);
    float u = l->waned / half;
    return power_of_two(-u * u / (1.0F + u) * 2.0F);
}

void ease_limb(limb_task *task, const tracked *t, const bs_settings *settings, int limb, bool changed,
                      float c, float sine, bool begun, limb_state *l) {
    uint8_t seen = seen_by(t, limb);
    bool middle_seen = t->has_position[LIMB[limb].middle];
    vec3 end = into_heading(task->end, c, sine), middle = into_heading(task->middle, c, sine);
    bool found = begun && seen > l->seen, went = begun && seen < l->seen;
    if (went && seen == 0 && !middle_seen) {
        l->end_kept = l->end_output;
        l->middle_kept = l->middle_output;
        l->end_leaving = limited(l->end_speed, EASE_FASTEST);
        l->lost = l->waned = 0.0F;
        l->end = l->middle = ease_begin(vec(0, 0, 0), 0.0F); /* what is kept is what was output, eased or not */
    }
    if (seen > 0 || middle_seen || !begun) l->lost = -1.0F;
    if (l->lost >= 0.0F) {
        l->lost += t->interval;
        float share = kept_share(task, t, limb, l);
        float gone = LOST_LEAVING * (1.0F - exponential(-l->lost / LOST_LEAVING));
        end = mix(end, along(l->end_kept, l->end_leaving, gone), share);
        middle = mix(middle, along(l->middle_kept, l->end_leaving, 0.5F * gone), share);
    }
    float ease_seen = (float)settings->ease;
    bool end_breaks = found || (begun && seen != l->seen && l->lost < 0.0F) || (changed && seen == 0 && l->lost < 0.0F);
    bool middle_found = begun && middle_seen && !l->middle_seen, middle_went = begun && !middle_seen && l->middle_seen;
    bool middle_breaks = middle_found || middle_went ||
                         (begun && !middle_seen && (found || (changed && l->lost < 0.0F)));
    /* Offsets that held or pulled a predicted joint are kept when it is measured. */
    vec3 end_held = found ? into_heading(l->end_held, c, sine) : vec(0, 0, 0);
    vec3 middle_held = middle_found ? into_heading(l->middle_held, c, sine) : vec(0, 0, 0);
    float steepest = is_leg(limb) ? 0.0F : ARM_STEEPEST;
    end = eased(&l->end, end, add(l->end_output, end_held), l->end_speed, t->interval, end_breaks,
                seen > 0 ? ease_seen : BLEND, steepest);
    middle = eased(&l->middle, middle, add(l->middle_output, middle_held), l->middle_speed, t->interval, middle_breaks,
                   middle_seen ? ease_seen : BLEND, steepest);
    task->end = from_heading(end, c, sine);
    task->middle = from_heading(middle, c, sine);
    l->seen = seen;
    l->middle_seen = middle_seen;
}

void remember_limb(const body *b, int limb, float interval, bool begun, limb_state *l) {
    float c, s;
    limb_heading(b, limb, &c, &s);
    const limb_joints *j = &LIMB[limb];
    vec3 end = into_heading(sub(sub(b->point[j->end], b->point[j->start]), l->end_shift), c, s);
    vec3 middle = into_heading(sub(sub(b->point[j->middle], b->point[j->start]), l->middle_shift), c, s);
    float rate = begun ? 1.0F / interval : 0.0F;
    l->end_speed = scale(sub(end, l->end_output), rate);
    l->middle_speed = scale(sub(middle, l->middle_output), rate);
    l->end_output = end;
    l->middle_output = middle;
}
