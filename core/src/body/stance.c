/* Stance: see stance.h. */
#include "stance.h"

#include "../base/kinematics.h"
#include "../base/maths.h"
#include "../constants.h"

static const signed char LEG[2][4] = {
    {LEFT_HIP, LEFT_KNEE, LEFT_ANKLE, LEFT_FOOT}, {RIGHT_HIP, RIGHT_KNEE, RIGHT_ANKLE, RIGHT_FOOT}};

/* Whether a point of a leg is measured. */
static bool leg_measured(const tracked *t) {
    for (int k = 0; k < 2; k++)
        for (int j = 0; j < 4; j++)
            if (is_measured(t, LEG[k][j])) return true;
    return t->has_position[LEFT_TOE] || t->has_position[RIGHT_TOE];
}

void turn_stance(const tracked *t, pose_state *s, prediction *p) {
    float predicted = t->has_position[HEAD] && !leg_measured(t) ? 1.0F : 0.0F;
    float share = s->begun ? 1.0F - power_of_two(-t->interval / STANCE_FADE) : 1.0F;
    s->stance += share * (predicted - s->stance);
    if (!t->has_position[HEAD] || s->stance == 0.0F) return;
    float high = (t->position[HEAD].y - t->floor) / standing_height(t, HEAD);
    float stands = clamp((high - BALANCE_LOW) / (BALANCE_STANDS - BALANCE_LOW), 0.0F, 1.0F);
    vec3 feet = vec(0, 0, 0);
    float cosine, sine;
    for (int k = 0; k < 2; k++) feet = add(feet, rotate(p->rotation[LEFT_ANKLE + k], t->rest_offset[LEFT_FOOT + k]));
    heading_of(known_rotation(t, PELVIS) ? t->rotation[PELVIS] : p->rotation[PELVIS], &cosine, &sine);
    vec3 ahead = into_heading(feet, cosine, sine);
    float behind = angle_of(ahead.x, ahead.z);
    float turn = -s->stance * stands * (behind - clamp(behind, -STANCE_TURNED, STANCE_TURNED));
    if (turn == 0.0F) return;
    for (int k = 0; k < 2; k++)
        for (int j = 0; j < 4; j++) p->rotation[LEG[k][j]] = turned_by(p->rotation[LEG[k][j]], scale(UP, turn));
}
