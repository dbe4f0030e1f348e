/* Decaying offsets: see offset_decay.h. The offset of each joint decays like a critically damped spring. */
#include "offset_decay.h"

#include "../base/kinematics.h"
#include "../base/maths.h"
#include "../constants.h"

/* Points that affect the whole predicted body; the two hips count together. Cameras lose and find the other points in
 * most frames, so those are ignored. */
static const int DECISIVE[] = {HEAD, PELVIS, LEFT_WRIST, RIGHT_WRIST, LEFT_ANKLE, RIGHT_ANKLE};

static bool decisive_change(const tracked *t, const pose_state *s) {
    for (size_t k = 0; k < sizeof DECISIVE / sizeof *DECISIVE; k++)
        if (t->has_position[DECISIVE[k]] != (s->had_position[DECISIVE[k]] != 0)) return true;
    return (t->has_position[LEFT_HIP] && t->has_position[RIGHT_HIP]) !=
           (s->had_position[LEFT_HIP] && s->had_position[RIGHT_HIP]);
}

/* Advance the spring of one joint by `interval` seconds. */
static void fade(offset_decay *joint, float interval) {
    const float stiffness = 1.678F / OFFSET_HALF_LIFE; /* 1/s: (1 + x)·exp(−x) is a half at x = 1.678 */
    vec3 pace = along(joint->speed, joint->off, stiffness);
    float remaining = exponential(-stiffness * interval);
    joint->off = scale(along(joint->off, pace, interval), remaining);
    joint->speed = scale(along(joint->speed, pace, -stiffness * interval), remaining);
}

void decay_offsets(const tracked *t, pose_state *s, prediction *p) {
    bool changed = s->begun && decisive_change(t, s);
    for (int j = 0; j < BODY_JOINTS; j++) {
        offset_decay *joint = &s->offset_decay[j];
        mat3 predicted = p->rotation[j];
        if (s->begun) fade(joint, t->interval);
        if (changed) {
            mat3 expected = turned_by(joint->predicted, scale(joint->spin, t->interval));
            joint->off = add(joint->off, turn_between(predicted, expected));
            joint->spin = scale(joint->spin, OFFSET_TRUSTED);
        } else if (s->begun) {
            vec3 spin = scale(turn_between(joint->predicted, predicted), 1.0F / t->interval);
            if (s->sensors_changed) {
                vec3 carried = scale(sub(joint->spin, spin), OFFSET_CARRIED);
                joint->off = along(joint->off, carried, t->interval);
                joint->speed = add(joint->speed, carried);
            }
            joint->spin = spin;
        }
        if (t->at_once) joint->off = joint->speed = vec(0, 0, 0);
        joint->predicted = predicted;
        p->rotation[j] = turned_by(predicted, joint->off);
    }
    s->sensors_changed = changed;
}
