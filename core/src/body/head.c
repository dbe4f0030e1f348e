/* The head as the network reads it: see head.h. */
#include "head.h"

#include "../base/kinematics.h"
#include "../network/model.h"
#include "../constants.h"

/* The rotation of a head that is placed but not turned: the chest's or pelvis's, else level and facing as the body. */
static mat3 likely_rotation(const pose_state *s, const tracked *t) {
    static const signed char PAIR[3][2] = {
        {LEFT_HIP, RIGHT_HIP}, {LEFT_SHOULDER, RIGHT_SHOULDER}, {LEFT_ANKLE, RIGHT_ANKLE}};
    if (known_rotation(t, SPINE3)) return t->rotation[SPINE3];
    if (known_rotation(t, PELVIS)) return t->rotation[PELVIS];
    vec3 line = vec(0, 0, 0);
    for (int k = 0; k < 3; k++)
        if (t->has_position[PAIR[k][0]] && t->has_position[PAIR[k][1]])
            line = add(line, sub(t->position[PAIR[k][0]], t->position[PAIR[k][1]]));
    line.y = 0.0F;
    vec3 ahead = length(line) > SHORTEST_LINE ? unit(cross(line, UP)) : s->course;
    if (dot(ahead, ahead) == 0.0F) ahead = vec(0, 0, 1);
    return (mat3){cross(UP, ahead), UP, ahead};
}

head_reading readable_head(const bs_model *model, const pose_state *s, tracked *t) {
    head_reading measured = {t->has_rotation[HEAD], t->rotation[HEAD]};
    if (!t->has_position[HEAD]) {
        t->has_rotation[HEAD] = measured.turned && model->reads_unplaced_head;
    } else if (!measured.turned) {
        mat3 likely = likely_rotation(s, t);
        vec3 crown = rotate(likely, t->rest_offset[HEAD_TOP]);
        if (t->has_position[HEAD_TOP]) likely = turned_onto(likely, crown, sub(t->position[HEAD_TOP], t->position[HEAD]));
        t->rotation[HEAD] = likely;
        t->has_rotation[HEAD] = true;
    }
    return measured;
}

void measured_head(head_reading measured, tracked *t) {
    t->has_rotation[HEAD] = measured.turned;
    t->rotation[HEAD] = measured.rotation;
}

vec3 next_course(const pose_state *s, const tracked *t) {
    vec3 goes = vec(s->head_speed.x, 0, s->head_speed.z);
    float cosine, sine;
    if (t->has_rotation[HEAD]) {
        heading_of(t->rotation[HEAD], &cosine, &sine);
        return vec(sine, 0, cosine);
    }
    float share = 1.0F - power_of_two(-t->interval / COURSE_HALF_LIFE);
    return length(goes) < COURSE_SPEED ? s->course : unit(mix(s->course, unit(goes), share));
}
