/* Arms and legs: two bones each that come to where their joints are measured or predicted. */
#include "limbs.h"

#include "../base/kinematics.h"
#include "../base/maths.h"
#include "../constants.h"

const limb_joints LIMB[LIMBS] = {
    {LEFT_COLLAR, LEFT_SHOULDER, LEFT_ELBOW, LEFT_WRIST,
     {LEFT_INDEX1, LEFT_MIDDLE1, LEFT_RING1, LEFT_PINKY1, LEFT_THUMB1}},
    {RIGHT_COLLAR, RIGHT_SHOULDER, RIGHT_ELBOW, RIGHT_WRIST,
     {RIGHT_INDEX1, RIGHT_MIDDLE1, RIGHT_RING1, RIGHT_PINKY1, RIGHT_THUMB1}},
    {PELVIS, LEFT_HIP, LEFT_KNEE, LEFT_ANKLE, {LEFT_FOOT, -1, -1, -1, -1}},
    {PELVIS, RIGHT_HIP, RIGHT_KNEE, RIGHT_ANKLE, {RIGHT_FOOT, -1, -1, -1, -1}},
};

/* The direction in which a limb's middle joint never goes, turned with the limb from its predicted upper bone. */
static vec3 unnatural_side(int limb, mat3 start, vec3 upper, vec3 direction) {
    mat3 turned = turned_onto(start, upper, direction);
    return is_leg(limb) ? scale(turned.z, -1.0F) : turned.z;
}

/* Hinge axis of a knee, toward the left, from the rotations of a measured pelvis and ankle. */
static vec3 measured_hinge(const tracked *t, int limb) {
    vec3 axis = vec(0, 0, 0);
    if (!is_leg(limb) || !known_rotation(t, LIMB[limb].end) || !t->has_position[LIMB[limb].end]) return axis;
    axis = t->rotation[LIMB[limb].end].x;
    return known_rotation(t, PELVIS) ? add(axis, t->rotation[PELVIS].x) : axis;
}

/* Position of an unmeasured middle joint: as predicted, but on its natural side. */
static vec3 natural_middle(const tracked *t, int limb, const limb_task *task, mat3 start) {
    float whole = length(task->upper) + length(task->lower);
    vec3 direction = unit(task->end);
    vec3 unnatural = unnatural_side(limb, start, task->upper, direction);
    float wrong = is_leg(limb) ? fmaxf(dot(task->middle, unnatural), 0.0F) : 0.0F;
    vec3 side = along(task->middle, unnatural, -(wrong + (is_leg(limb) ? LEG_BENT : ARM_BENT) * whole));
    vec3 hinge = measured_hinge(t, limb);
    if (dot(hinge, hinge) == 0.0F) return side;
    return add(unit(across(side, direction)), scale(cross(direction, hinge), KNEE_HINGE));
}

void keep_forward(limb_task *task, const tracked *t, int limb, mat3 thigh) {
    vec3 upper = rotate(thigh, t->rest_offset[LIMB[limb].middle]);
    vec3 backward = unnatural_side(limb, thigh, upper, unit(task->end));
    task->middle = along(task->middle, backward, -fmaxf(dot(task->middle, backward), 0.0F));
}

void find_stand_ins(const bs_settings *settings, pose_state *s, tracked *t) {
    for (int limb = 0; limb < LIMBS; limb++) {
        const signed char *point = LIMB[limb].stand_in;
        float *stood = &s->limb[limb].stood, ease = (float)settings->ease;
        bool any = false;
        for (int k = 0; k < 5 && point[k] >= 0; k++) any |= t->has_position[point[k]];
        *stood = !any ? 0.0F : s->begun ? *stood + t->interval : ease;
        t->stands_in[limb] = any && (is_leg(limb) || *stood >= ease);
    }
}

limb_task limb_goal(const tracked *t, int limb, const mat3 rotation[BODY_JOINTS], const body *b, vec3 start) {
    const limb_joints *j = &LIMB[limb];
    bool start_turned = known_rotation(t, j->start), middle_turned = known_rotation(t, j->middle);
    mat3 upper = start_turned ? b->rotation[j->start] : rotation[j->start]; /* measured ones are eased already */
    mat3 lower = middle_turned ? b->rotation[j->middle] : rotation[j->middle];
    limb_task task = {
        .end_seen = t->has_position[j->end],
        .middle_seen = t->has_position[j->middle],
        .start_turned = start_turned,
        .middle_turned = middle_turned,
        .upper = rotate(upper, t->rest_offset[j->middle]),
        .lower = rotate(lower, t->rest_offset[j->end]),
        .ahead = is_leg(limb) ? lower.z : vec(0, 0, 0),
    };
    task.middle = task.middle_seen ? sub(t->position[j->middle], start) : task.upper;
    task.end = add(task.middle, task.lower);
    if (task.end_seen) {
        task.end = sub(t->position[j->end], start);
    } else if (t->stands_in[limb]) {
        vec3 off = vec(0, 0, 0);
        float count = 0.0F;
        for (int k = 0; k < 5 && j->stand_in[k] >= 0; k++) {
            int p = j->stand_in[k];
            if (!t->has_position[p]) continue;
            vec3 there = add(add(start, task.end), rotate(b->rotation[j->end], t->rest_offset[p]));
            off = add(off, sub(t->position[p], there));
            count += 1.0F;
        }
        task.end = along(task.end, off, 1.0F / count);
    }
    if (!task.middle_seen) {
        if (task.end_seen && task.middle_turned) {
            task.middle = sub(task.end, task.lower);
        } else if (!task.start_turned) {
            task.middle = natural_middle(t, limb, &task, rotation[j->start]);
        }
    }
    return task;
}

two_bones solve_limb(const limb_task *task) {
    float upper = length(task->upper), lower = length(task->lower);
    vec3 middle;
    if (task->middle_seen) {
        middle = scale(unit(task->middle), upper);
    } else if (task->start_turned) {
        middle = task->upper;
    } else if (task->middle_turned) {
        vec3 thigh = sub(task->end, task->lower);
        float backward = task->end_seen ? 0.0F : fmaxf(-dot(thigh, task->ahead), 0.0F);
        middle = scale(unit(along(thigh, task->ahead, backward)), upper);
    } else {
        return reach(task->end, upper, lower, task->middle);
    }
    bool by_rotation = task->middle_turned && !task->end_seen;
    vec3 direction = by_rotation ? task->lower : scale(unit(sub(task->end, middle)), lower);
    two_bones result = {middle, add(middle, direction)};
    return result;
}

/* The axis about which an elbow bends in the T-pose, across its bone: downward on the left, upward on the right. */
static vec3 hinge_axis(const tracked *t, int limb, const hinge_state *hinge) {
    float side = limb == LEFT_ARM ? 1.0F : -1.0F;
    vec3 axis = vec(0, -side * (hinge->upright + HINGE_UPRIGHT), side * (hinge->tilted + HINGE_TILTED));
    return unit(across(axis, unit(t->rest_offset[LIMB[limb].middle])));
}

void learn_hinge(const tracked *t, int limb, const mat3 rotation[BODY_JOINTS], hinge_state *hinge) {
    const limb_joints *j = &LIMB[limb];
    if (known_rotation(t, j->start) || known_rotation(t, j->middle)) return;
    mat3 bend = product(transpose(rotation[j->start]), rotation[j->middle]);
    float side = limb == LEFT_ARM ? 1.0F : -1.0F; /* sin(angle) axis = (m - mᵀ) / 2 */
    float upright = 0.5F * side * (bend.x.z - bend.z.x), tilted = 0.5F * side * (bend.x.y - bend.y.x);
    float bent = sqrtf(upright * upright + tilted * tilted), share = t->interval * HINGE_RATE;
    hinge->upright += share * bent * upright;
    hinge->tilted += share * bent * tilted;
    float size = sqrtf(hinge->upright * hinge->upright + hinge->tilted * hinge->tilted);
    if (size > HINGE_MOST) {
        hinge->upright *= HINGE_MOST / size;
        hinge->tilted *= HINGE_MOST / size;
    }
}

void hinge_elbow(body *b, const tracked *t, int limb, const hinge_state *hinge) {
    const limb_joints *j = &LIMB[limb];
    if (known_rotation(t, j->start) || known_rotation(t, j->middle)) return;
    vec3 upper = unit(rotate(b->rotation[j->start], t->rest_offset[j->middle]));
    vec3 lower = rotate(b->rotation[j->middle], t->rest_offset[j->end]);
    vec3 bends = cross(upper, unit(lower)), axis = rotate(b->rotation[j->start], hinge_axis(t, limb, hinge));
    float share = fminf(fmaxf((length(bends) - HINGE_FROM) / (HINGE_FULL - HINGE_FROM), 0.0F), 1.0F);
    float angle = angle_of(dot(cross(axis, bends), upper), dot(axis, bends));
    b->rotation[j->start] = turned_by(b->rotation[j->start], scale(upper, share * angle));
    vec3 straight = rotate(b->rotation[j->start], t->rest_offset[j->end]);
    mat3 hinged = turned_onto(b->rotation[j->start], straight, lower);
    vec3 turn = turn_between(b->rotation[j->middle], hinged);
    b->rotation[j->middle] = turned_by(b->rotation[j->middle], scale(turn, share));
    /* A turn about the forearm keeps its direction only as a whole. */
    vec3 now = rotate(b->rotation[j->middle], t->rest_offset[j->end]);
    b->rotation[j->middle] = turned_onto(b->rotation[j->middle], now, lower);
}

void turn_limb(body *b, const tracked *t, int limb, two_bones to) {
    const limb_joints *j = &LIMB[limb];
    vec3 upper = rotate(b->rotation[j->start], t->rest_offset[j->middle]);
    vec3 lower = rotate(b->rotation[j->middle], t->rest_offset[j->end]);
    b->rotation[j->start] = turned_onto(b->rotation[j->start], upper, to.middle);
    b->rotation[j->middle] = turned_onto(b->rotation[j->middle], lower, sub(to.end, to.middle));
}
