/* Settling: see settle.h. What is taken back fades as a critically damped spring does, a joint at a time. */
#include "settle.h"

#include "kinematics.h"

/* Points that decide about a whole body, and so do both hips together. Cameras see the others come and go in most
 * frames. */
static const int DECISIVE[] = {HEAD, PELVIS, LEFT_WRIST, RIGHT_WRIST, LEFT_ANKLE, RIGHT_ANKLE};

/* Chosen on validation people. */
static const float SETTLED = 0.1F; /* s after which about half is left */
static const float TRUSTED = 0.7F; /* of a joint's spin is left after every frame in which a sensor came or went */
static const float CARRIED = 0.5F; /* of the change of a joint's spin meanwhile is made gradual */

static bool decisive_change(const tracked *t, const pose_state *s) {
    for (size_t k = 0; k < sizeof DECISIVE / sizeof *DECISIVE; k++)
        if (t->has_position[DECISIVE[k]] != (s->had_position[DECISIVE[k]] != 0)) return true;
    return (t->has_position[LEFT_HIP] && t->has_position[RIGHT_HIP]) !=
           (s->had_position[LEFT_HIP] && s->had_position[RIGHT_HIP]);
}

/* Let the spring of one joint go on for `interval` seconds. */
static void fade(settling *joint, float interval) {
    const float stiffness = 1.678F / SETTLED; /* 1/s: (1 + x)·exp(−x) is a half at x = 1.678 */
    vec3 pace = along(joint->speed, joint->off, stiffness);
    float left = expf(-stiffness * interval);
    joint->off = scale(along(joint->off, pace, interval), left);
    joint->speed = scale(along(joint->speed, pace, -stiffness * interval), left);
}

void settle(const tracked *t, pose_state *s, prediction *p) {
    bool changed = s->begun && decisive_change(t, s);
    for (int j = 0; j < BODY_JOINTS; j++) {
        settling *joint = &s->settling[j];
        mat3 predicted = p->rotation[j];
        if (s->begun) fade(joint, t->interval);
        if (changed) {
            mat3 expected = turned_by(joint->predicted, scale(joint->spin, t->interval));
            joint->off = add(joint->off, turn_between(predicted, expected));
            joint->spin = scale(joint->spin, TRUSTED);
        } else if (s->begun) {
            vec3 spin = scale(turn_between(joint->predicted, predicted), 1.0F / t->interval);
            if (s->unsettled) {
                vec3 carried = scale(sub(joint->spin, spin), CARRIED);
                joint->off = along(joint->off, carried, t->interval);
                joint->speed = add(joint->speed, carried);
            }
            joint->spin = spin;
        }
        if (t->at_once) joint->off = joint->speed = vec(0, 0, 0);
        joint->predicted = predicted;
        p->rotation[j] = turned_by(predicted, joint->off);
    }
    s->unsettled = changed;
}
