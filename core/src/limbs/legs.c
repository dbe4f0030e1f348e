/* Legs: see legs.h. */
#include "legs.h"

#include "../base/kinematics.h"
#include "../base/maths.h"
#include "../body/trunk.h"
#include "../constants.h"
#include "feet.h"

/* How far the pelvis has to move for a leg whose measured knee or ankle it does not reach. */
static vec3 leg_lack(const limb_task *task) {
    float upper = length(task->upper), lower = length(task->lower);
    if (task->middle_seen) return sub(task->middle, scale(unit(task->middle), upper));
    float lacking = length(task->end) - LIMB_STRAIGHT * (upper + lower);
    return task->end_seen && lacking > 0.0F ? scale(unit(task->end), lacking) : vec(0, 0, 0);
}

/* Move the pelvis by bending the spine. Measured joints of the legs stay where they are. */
static void move_pelvis(body *b, const tracked *t, limb_task task[2], vec3 move) {
    vec3 before = b->point[PELVIS];
    bend_spine(b, t, move);
    vec3 pelvis_shift = sub(b->point[PELVIS], before);
    for (int k = 0; k < 2; k++) {
        if (task[k].end_seen) task[k].end = sub(task[k].end, pelvis_shift);
        if (task[k].middle_seen) task[k].middle = sub(task[k].middle, pelvis_shift);
    }
}

/* Move a pelvis that is not measured so that legs reach their measured joints. */
static void pull_pelvis(body *b, const tracked *t, pose_state *s, limb_task task[2]) {
    vec3 before = b->point[PELVIS];
    uint8_t pulling = 0;
    for (int k = 0; k < 2; k++)
        if (!pelvis_seen(t)) pulling = (uint8_t)(pulling | ((task[k].middle_seen ? 1 : 0) + (task[k].end_seen ? 2 : 0)) << 2 * k);
    for (int round = 0; round < PELVIS_PULLS && pulling != 0; round++) {
        vec3 lack = vec(0, 0, 0);
        float count = 0.0F;
        for (int k = 0; k < 2; k++) {
            if (!task[k].middle_seen && !task[k].end_seen) continue;
            lack = add(lack, leg_lack(&task[k]));
            count += 1.0F;
        }
        vec3 pelvis_shift = sub(b->point[PELVIS], before);
        move_pelvis(b, t, task, sub(limited(along(pelvis_shift, lack, 1.0F / count), PELVIS_MOST_SHIFT), pelvis_shift));
    }
    vec3 pelvis_shift = sub(b->point[PELVIS], before);
    bool breaks = s->begun && pulling != s->pulling;
    float span = t->at_once ? 0.0F : BLEND;
    vec3 eased_shift = eased(&s->pull, pelvis_shift, s->pulled, s->pulled_speed, t->interval, breaks, span, 0.0F);
    move_pelvis(b, t, task, sub(eased_shift, pelvis_shift));
    s->pulling = pulling;
    vec3 pulled = sub(b->point[PELVIS], before);
    s->pulled_speed = scale(sub(pulled, s->pulled), s->begun ? 1.0F / t->interval : 0.0F);
    s->pulled = pulled;
}

/* 1 if feet carry the body: it stands, walks, crouches or is on a chair; 0 if it lies, sits on the floor or jumps. */
static float uprightness(const body *b, const tracked *t, const pose_state *s) {
    float tall = standing_height(t, HEAD), high = b->point[HEAD].y - t->floor;
    float risen = fminf(fmaxf((high / tall - HEAD_LOW) / (HEAD_SEATED - HEAD_LOW), 0.0F), 1.0F);
    float carried = (b->point[PELVIS].y - t->floor) / standing_height(t, PELVIS);
    risen = fmaxf(risen, fminf((carried - PELVIS_LOW) / (PELVIS_BOWS - PELVIS_LOW), 1.0F));
    float fastest = s->head_speed.y < 0.0F && high < HEAD_STRETCHED * tall ? HEAD_FALLING : HEAD_STEADY;
    float calm = fminf(fmaxf((fastest - fabsf(s->head_speed.y)) / (0.5F * fastest), 0.0F), 1.0F);
    return high > tall + HEAD_OVER ? 0.0F : risen * calm;
}

/* How much lower the pelvis must be for a leg or a thigh to reach its end (m). */
static float lacking_height(vec3 hip, vec3 end, float longest) {
    float away = (end.x - hip.x) * (end.x - hip.x) + (end.z - hip.z) * (end.z - hip.z);
    float square = longest * longest - away;
    return square > 0.0F ? fmaxf(hip.y - end.y - sqrtf(square), 0.0F) : 0.0F;
}

/* Turn a foot that stands so that its ball is as far below its ankle as at rest. */
static void flatten_foot(body *b, const tracked *t, int ankle, int ball, float below, float share) {
    if (share == 0.0F || known_rotation(t, ankle) || t->has_position[ball]) return;
    vec3 bone = rotate(b->rotation[ankle], t->rest_offset[ball]);
    vec3 level = unit(vec(bone.x, 0, bone.z));
    float size = length(bone), forward = sqrtf(fmaxf(size * size - below * below, 0.0F));
    mat3 flat = turned_onto(b->rotation[ankle], bone, mix(bone, along(scale(level, forward), UP, -below), share));
    vec3 turn = turn_between(b->rotation[ankle], flat);
    b->rotation[ankle] = turned_by(b->rotation[ankle], turn);
    if (!known_rotation(t, ball)) b->rotation[ball] = turned_by(b->rotation[ball], turn);
}

/* Turn a foot about the vertical through its ankle (rad). */
static void turn_foot(body *b, const tracked *t, int ankle, int ball, float turn) {
    if (turn == 0.0F || known_rotation(t, ankle)) return;
    b->rotation[ankle] = turned_by(b->rotation[ankle], scale(UP, turn));
    if (!known_rotation(t, ball)) b->rotation[ball] = turned_by(b->rotation[ball], scale(UP, turn));
}

/* Lay a shin on the floor whose ankle would be lower than `least` (m, from the hip): back from the knee if it is steep. */
static two_bones lay_shin(two_bones to, vec3 back, float least) {
    vec3 shin = sub(to.end, to.middle);
    float size = length(shin), up = fminf(fmaxf(least - to.middle.y, -size), size);
    if (to.end.y >= least) return to;
    vec3 level = unit(add(vec(shin.x, 0, shin.z), scale(back, SHIN_STEEP * size)));
    to.end = add(to.middle, along(scale(level, sqrtf(size * size - up * up)), UP, up));
    return to;
}

/* Turn a bone of a foot up so that its end is not under the floor. */
static void turn_up(body *b, const tracked *t, int joint, vec3 start, int end) {
    vec3 bone = rotate(b->rotation[joint], t->rest_offset[end]);
    float least = t->floor - start.y, size = length(bone);
    bool measured = t->has_position[end] && t->position[end].y < t->floor;
    if (bone.y >= least || least >= size || known_rotation(t, joint) || measured) return;
    vec3 level = unit(vec(bone.x, 0, bone.z));
    vec3 raised = along(scale(level, sqrtf(size * size - least * least)), UP, least);
    vec3 turn = turn_between(b->rotation[joint], turned_onto(b->rotation[joint], bone, raised));
    b->rotation[joint] = turned_by(b->rotation[joint], turn);
    int next = end < BODY_JOINTS && !known_rotation(t, end) ? end : joint;
    if (next != joint) b->rotation[next] = turned_by(b->rotation[next], turn);
}

void move_legs(body *b, const tracked *t, const prediction *p, const mat3 goal[BODY_JOINTS],
                      const bs_settings *settings, const bool changed[GROUPS], pose_state *s) {
    limb_task task[2];
    float c, sine;
    for (int k = 0; k < 2; k++) task[k] = limb_goal(t, LEFT_LEG + k, goal, b, b->point[LEFT_HIP + k]);
    pull_pelvis(b, t, s, task);
    limb_heading(b, LEFT_LEG, &c, &sine);
    foot feet[2];
    two_bones free[2];
    for (int k = 0; k < 2; k++) {
        const limb_joints *j = &LIMB[LEFT_LEG + k];
        ease_limb(&task[k], t, settings, LEFT_LEG + k, changed[LEFT_LEG + k], c, sine, s->begun, &s->limb[LEFT_LEG + k]);
        bool eases = easing(&s->limb[LEFT_LEG + k].end) || easing(&s->limb[LEFT_LEG + k].middle);
        if (eases) keep_forward(&task[k], t, LEFT_LEG + k, b->rotation[j->start]);
        two_bones to = free[k] = solve_limb(&task[k]);
        int ball = LEFT_FOOT + k, toe = LEFT_TOE + k;
        foot *f = &feet[k];
        f->ankle = add(b->point[j->start], to.end);
        f->ankle_rest = standing_height(t, j->end);
        f->ball_rest = standing_height(t, ball);
        flatten_foot(b, t, j->end, ball, f->ankle_rest - f->ball_rest, flatness(&s->foot[k]));
        f->ball = add(f->ankle, rotate(b->rotation[j->end], t->rest_offset[ball]));
        f->toe = add(f->ball, rotate(b->rotation[ball], t->rest_offset[toe]));
        f->ankle_contact = p->contact[k];
        f->ball_contact = p->contact[2 + k];
        f->seen = t->has_position[j->end] || t->has_position[ball] || t->has_position[toe];
        f->turned = known_rotation(t, j->end);
        f->driven = task[k].middle_seen || task[k].start_turned || task[k].middle_turned || eases;
        f->met = t->has_position[j->end] && !easing(&s->limb[LEFT_LEG + k].end);
        f->away = t->has_position[j->end] ? length(sub(t->position[j->end], f->ankle)) : 0.0F;
        float knee = b->point[j->start].y + to.middle.y - t->floor;
        f->kneels = fminf(fmaxf((KNEE_UP - knee) / (KNEE_UP - KNEE_DOWN), 0.0F), 1.0F);
    }
    vec3 move[2] = {{0, 0, 0}, {0, 0, 0}};
    if (settings->hold_feet) {
        foot_move moved[2];
        float speed = length(vec(s->head_speed.x, 0, s->head_speed.z));
        const carrier carried = {b->point[HEAD], c, sine, speed};
        hold_feet(feet, carried, t->floor, t->interval, uprightness(b, t, s), s->foot, moved);
        for (int k = 0; k < 2; k++) {
            move[k] = moved[k].shift;
            turn_foot(b, t, LEFT_ANKLE + k, LEFT_FOOT + k, moved[k].turn);
        }
    }
    float lacking = 0.0F, settle = 1.0F - power_of_two(-t->interval / PELVIS_SETTLE);
    for (int k = 0; k < 2; k++) {
        if (s->foot[k].held == 0 || s->foot[k].step.span > 0.0F) continue;
        float longest = LIMB_STRAIGHT * (length(task[k].upper) + length(task[k].lower));
        vec3 end = add(feet[k].ankle, move[k]);
        if (task[k].middle_turned) { /* a shin with a measured rotation does not stretch the leg */
            longest = length(task[k].upper);
            end = sub(end, task[k].lower);
        }
        lacking = fmaxf(lacking, lacking_height(b->point[LEFT_HIP + k], end, longest));
    }
    if (pelvis_seen(t)) lacking = 0.0F;
    s->standing_drop += settle * (fminf(lacking, PELVIS_MOST_SHIFT) - s->standing_drop);
    vec3 pelvis = b->point[PELVIS];
    bend_spine(b, t, vec(0, -s->standing_drop, 0));
    vec3 pelvis_shift = sub(b->point[PELVIS], pelvis);
    for (int k = 0; k < 2; k++) {
        /* Feet stay where they are when the pelvis is lowered for them. */
        vec3 shift = sub(move[k], pelvis_shift);
        task[k].end = add(task[k].end, shift);
        if (task[k].middle_seen) task[k].middle = sub(task[k].middle, pelvis_shift);
        else keep_forward(&task[k], t, LEFT_LEG + k, b->rotation[LEFT_HIP + k]);
        two_bones to = solve_limb(&task[k]);
        if (settings->hold_feet && task[k].middle_seen && !task[k].end_seen && !task[k].middle_turned) {
            float lowest = t->floor + feet[k].kneels * feet[k].ankle_rest; /* legs that stand bob by less than that */
            to = lay_shin(to, from_heading(vec(0, 0, -1), c, sine), lowest - b->point[LEFT_HIP + k].y);
        }
        turn_limb(b, t, LEFT_LEG + k, to);
        limb_state *l = &s->limb[LEFT_LEG + k];
        if (task[k].middle_seen || task[k].start_turned || task[k].middle_turned) {
            /* Measured bones do not give way: what they refuse is not held. */
            vec3 refused = sub(sub(to.end, free[k].end), shift);
            s->foot[k].anchor = add(s->foot[k].anchor, refused);
            s->foot[k].slide = add(s->foot[k].slide, vec(refused.x, 0, refused.z));
            s->foot[k].drop -= refused.y;
            move[k] = add(move[k], refused);
        }
        if (settings->hold_feet) {
            int ankle = LIMB[LEFT_LEG + k].end, ball = LEFT_FOOT + k;
            vec3 start = add(b->point[LEFT_HIP + k], to.end);
            turn_up(b, t, ankle, start, ball);
            turn_up(b, t, ball, add(start, rotate(b->rotation[ankle], t->rest_offset[ball])), LEFT_TOE + k);
        }
        l->end_held = move[k];
        l->end_shift = sub(to.end, free[k].end);
        l->middle_shift = sub(to.middle, free[k].middle);
        l->middle_held = add(l->middle_shift, pelvis_shift);
    }
}
