/* Arms: from a shoulder that may be pulled by its collar to a measured or predicted wrist. */
#include "arms.h"

#include "../base/kinematics.h"
#include "../base/maths.h"
#include "../constants.h"

/* Where a shoulder goes: where it is measured, or where a measured elbow or a far wrist pulls it. From its collar, m. */
static vec3 pulled_shoulder(const tracked *t, int limb, vec3 collar, vec3 shoulder, const limb_task *task) {
    const limb_joints *j = &LIMB[limb];
    vec3 from = sub(shoulder, collar);
    if (known_rotation(t, j->carrier) || t->has_position[j->start]) return from;
    float size = length(from), upper = length(task->upper), lower = length(task->lower);
    vec3 pulled = from;
    if (task->middle_seen) {
        pulled = reach(add(from, task->middle), size, upper, from).middle;
        float doubt = COLLAR_DOUBT * t->accuracy[j->middle];
        pulled = mix(from, pulled, 1.0F / (1.0F + doubt * doubt));
    } else if (task->end_seen) {
        float lacking = length(task->end) - LIMB_STRAIGHT * (upper + lower);
        if (lacking > 0.0F) pulled = along(from, unit(task->end), lacking);
    }
    vec3 given = limited(sub(pulled, from), COLLAR_GIVES * size);
    return scale(unit(add(from, given)), size);
}

void move_arm(body *b, const tracked *t, const mat3 goal[BODY_JOINTS], const bs_settings *settings, int limb,
                     bool changed, pose_state *s) {
    const limb_joints *j = &LIMB[limb];
    vec3 collar = b->point[j->carrier], shoulder = b->point[j->start], before = sub(shoulder, collar);
    if (t->has_position[j->start] && !known_rotation(t, j->carrier)) {
        float doubt = COLLAR_DOUBT * t->accuracy[j->start];
        vec3 off = scale(sub(t->position[j->start], shoulder), 1.0F / (1.0F + doubt * doubt));
        shoulder = along(collar, unit(add(before, off)), length(before));
    }
    limb_task task = limb_goal(t, limb, goal, b, shoulder);
    const limb_task measured = task; /* a wrist that is still on its way does not pull its shoulder along */
    float c, sine;
    limb_heading(b, limb, &c, &sine);
    ease_limb(&task, t, settings, limb, changed, c, sine, s->begun, &s->limb[limb]);
    vec3 pulled = add(collar, pulled_shoulder(t, limb, collar, shoulder, &measured));
    /* A collar that is no longer pulled, or begins to be, goes there slowly. */
    limb_state *l = &s->limb[limb];
    uint8_t pulling = (uint8_t)((task.middle_seen ? 1 : 0) + (task.end_seen ? 2 : 0));
    float span = task.middle_seen || task.end_seen ? (float)settings->ease : BLEND;
    vec3 given = eased(&l->pull, sub(pulled, shoulder), l->pulled, l->pulled_speed, t->interval,
                       s->begun && pulling != l->pulling, span, 0.0F);
    pulled = add(collar, scale(unit(sub(add(shoulder, given), collar)), length(before)));
    given = sub(pulled, shoulder);
    l->pulled_speed = scale(sub(given, l->pulled), s->begun ? 1.0F / t->interval : 0.0F);
    l->pulled = given;
    l->end_shift = l->middle_shift = scale(given, -1.0F);
    l->pulling = pulling;
    task.end = sub(task.end, given);
    task.middle = sub(task.middle, given);
    b->rotation[j->carrier] = turned_onto(b->rotation[j->carrier], before, sub(pulled, collar));
    turn_limb(b, t, limb, solve_limb(&task));
    learn_hinge(t, limb, goal, &s->hinge);
    hinge_elbow(b, t, limb, &s->hinge);
}

mat3 chest_heading(const body *b) {
    float c, s;
    heading_of(b->rotation[SPINE3], &c, &s);
    return (mat3){{c, 0, -s}, {0, 1, 0}, {s, 0, c}};
}

void keep_wrists(body *b, const tracked *t, pose_state *s) {
    for (int k = 0; k < 2; k++) {
        int wrist = LEFT_WRIST + k;
        if (known_rotation(t, wrist)) {
            s->wrist_lost[k] = 0.0F;
            continue;
        }
        if (s->wrist_lost[k] < 0.0F) continue;
        s->wrist_lost[k] += t->interval;
        float u = s->wrist_lost[k] / WRIST_KEPT;
        vec3 turn = turn_between(b->rotation[wrist], product(chest_heading(b), s->wrist_kept[k]));
        b->rotation[wrist] = turned_by(b->rotation[wrist], scale(turn, (1.0F + u) * exponential(-u)));
    }
}
