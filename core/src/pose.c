/* From what the network predicts to a body that meets what is measured and moves without jumps.
 *
 *     rotations: measured, implied or predicted → eased where sensors came or went → the body hung on its head →
 *     spine bent to the pelvis → arms → legs, feet held and on the floor → rotations of the limbs
 */
#include "pose.h"

#include <string.h>

#include "feet.h"
#include "kinematics.h"
#include "limbs.h"
#include "tracked.h"

/* s in which predicted joints are eased after sensors came or went. */
static const float BLEND = 0.25F;
static const float FASTEST = 10.0F; /* m/s at which a point that is seen again is reached at most */
/* A lost wrist or ankle goes on with its velocity, which fades in LEAVING s, and gives way to the prediction. Half of
 * the way is left after KEPT s; of an arm that was raised after KEPT_RAISED s. */
static const float LEAVING = 0.08F, KEPT_LEG = 0.12F, KEPT_ARM = 0.35F, KEPT_RAISED = 3.0F;
static const float KEPT_WRIST = 10.0F;   /* s: nothing tells how a lost hand is turned, and it mostly stays so */
static const float SHOULDER_DOUBT = 25.0F; /* 1/m: a shoulder 4 cm off turns its collar half as far as a sure one */
static const float SPINE_BACK = 0.3F;   /* of its length: how far a straight spine bends backward first */
static const float COLLAR_GIVES = 0.8F;  /* of a collar's length: what it gives an arm that is too short */
static const float LONGEST = 0.9995F;    /* of a limb's length */
static const float MOST_MOVED = 0.15F;   /* m that a pelvis is moved for legs that do not reach */
#define PULLS 6 /* times that legs pull a pelvis */
static const float MOST_DRAWN = 0.1F;    /* m that a standing foot is drawn in below its hip */
static const float SETTLE = 0.06F;       /* s in which half of what a standing pelvis lacks is made up */
static const float STEADY = 0.7F;        /* m/s: a head that moves faster up or down jumps, sits down or rises */
static const float LEAST_DOUBT = 1e-6F;  /* m */

/* ---- what came and what went ------------------------------------------------------------------------------------- */

enum { TRUNK = LIMBS, GROUPS };

/* The group of each joint of the body. */
static const signed char GROUP[BODY_JOINTS] = {
    TRUNK, LEFT_LEG, RIGHT_LEG, TRUNK, LEFT_LEG, RIGHT_LEG, TRUNK, LEFT_LEG, RIGHT_LEG, TRUNK, LEFT_LEG, RIGHT_LEG,
    TRUNK, TRUNK, TRUNK, TRUNK, LEFT_ARM, RIGHT_ARM, LEFT_ARM, RIGHT_ARM, LEFT_ARM, RIGHT_ARM,
};

/* Which groups have a sensor that came or went. Fingers are in none. */
static void find_changes(const tracked *t, const pose_state *s, bool changed[GROUPS]) {
    for (int g = 0; g < GROUPS; g++) changed[g] = false;
    if (!s->begun) return;
    for (int j = 0; j < BODY_JOINTS; j++) {
        bool came = t->has_position[j] != (s->had_position[j] != 0);
        bool turned = known_rotation(t, j) != (s->had_rotation[j] != 0) && j != LEFT_WRIST && j != RIGHT_WRIST;
        if (came || turned) changed[GROUP[j]] = true;
    }
    if (t->has_position[LEFT_TOE] != (s->had_position[LEFT_TOE] != 0)) changed[LEFT_LEG] = true;
    if (t->has_position[RIGHT_TOE] != (s->had_position[RIGHT_TOE] != 0)) changed[RIGHT_LEG] = true;
    if (t->has_position[HEAD_TOP] != (s->had_position[HEAD_TOP] != 0)) changed[TRUNK] = true;
    if (changed[TRUNK])
        for (int k = 0; k < LIMBS; k++) changed[k] = true;
}

/* ---- easing ------------------------------------------------------------------------------------------------------ */

static vec3 limited(vec3 v, float most) {
    float size = length(v);
    return size > most ? scale(v, most / size) : v;
}

/* Ease a vector toward its goal. If its motion breaks, what is output goes on with its speed for a frame, and the
 * difference to the goal decays over `span` seconds from then on. Returns what to output. */
static vec3 eased(ease *e, vec3 goal, vec3 output_before, vec3 speed, float interval, bool breaks, float span) {
    if (breaks) {
        vec3 offset = sub(along(output_before, limited(speed, FASTEST), interval), goal);
        *e = ease_begin(offset, span > 0.0F ? fmaxf(span, ease_span(length(offset), FASTEST)) : 0.0F);
    } else {
        ease_advance(e, interval);
    }
    return add(goal, ease_offset(e));
}

/* The same for a rotation. */
static mat3 eased_turn(ease *e, mat3 goal, mat3 output_before, vec3 spin, float interval, bool breaks, float span) {
    if (breaks) {
        *e = ease_begin(turn_between(goal, turned_by(output_before, scale(spin, interval))), span);
    } else {
        ease_advance(e, interval);
    }
    return turned_by(goal, ease_offset(e));
}

/* ---- rotations --------------------------------------------------------------------------------------------------- */

/* Joints that are turned by a measured point further on, with that point. Limbs are bent instead. */
static const signed char DIRECTED[][2] = {
    {SPINE1, SPINE2},  {SPINE2, SPINE3},     {NECK, HEAD},           {HEAD, HEAD_TOP},      {LEFT_COLLAR, LEFT_SHOULDER},
    {RIGHT_COLLAR, RIGHT_SHOULDER}, {LEFT_ANKLE, LEFT_FOOT}, {RIGHT_ANKLE, RIGHT_FOOT}, {LEFT_FOOT, LEFT_TOE},
    {RIGHT_FOOT, RIGHT_TOE},
};

/* The rotations to come to: measured or implied, else as predicted and turned onto measured points. */
static void rotation_goals(const tracked *t, const prediction *p, mat3 goal[BODY_JOINTS]) {
    for (int j = 0; j < BODY_JOINTS; j++) goal[j] = known_rotation(t, j) ? t->rotation[j] : p->rotation[j];
    for (size_t k = 0; k < sizeof(DIRECTED) / sizeof(DIRECTED[0]); k++) {
        int joint = DIRECTED[k][0], child = DIRECTED[k][1];
        if (known_rotation(t, joint) || !t->has_position[joint] || !t->has_position[child]) continue;
        vec3 bone = rotate(goal[joint], t->rest_offset[child]);
        vec3 apart = sub(t->position[child], t->position[joint]);
        /* Where points err as much as they are apart, their direction says little. */
        float doubt = 2.0F * (t->accuracy[joint] + t->accuracy[child]) + LEAST_DOUBT;
        float square = dot(bone, bone);
        goal[joint] = turned_onto(goal[joint], bone, mix(bone, apart, square / (square + doubt * doubt)));
    }
    if (!known_rotation(t, PELVIS) && t->has_position[LEFT_HIP] && t->has_position[RIGHT_HIP]) {
        vec3 line = rotate(goal[PELVIS], sub(t->rest_offset[LEFT_HIP], t->rest_offset[RIGHT_HIP]));
        goal[PELVIS] = turned_onto(goal[PELVIS], line, sub(t->position[LEFT_HIP], t->position[RIGHT_HIP]));
    }
}

/* ---- trunk ------------------------------------------------------------------------------------------------------- */

static void place(body *b, const tracked *t, vec3 head) {
    for (int j = BODY_JOINTS; j < BS_JOINTS; j++)
        b->rotation[j] = b->rotation[j < RIGHT_INDEX1 ? LEFT_WRIST : RIGHT_WRIST];
    place_points(b, t->rest_offset, HEAD, head, BS_POINTS);
}

/* By how much a body placed by its predicted head has to move: so that a measured head, else a measured pelvis, else
 * the mean of what is seen is where it is. */
static vec3 placement(const body *b, const tracked *t, const prediction *p) {
    if (t->has_position[HEAD]) return sub(t->position[HEAD], b->point[HEAD]);
    if (t->has_position[PELVIS]) return sub(t->position[PELVIS], b->point[PELVIS]);
    vec3 off = vec(0, 0, 0);
    float count = 0.0F;
    for (int q = 0; q < BS_POINTS; q++) {
        if (!t->has_position[q]) continue;
        off = add(off, sub(t->position[q], b->point[q]));
        count += 1.0F;
    }
    return count > 0.0F ? scale(off, 1.0F / count) : sub(t->position[HEAD], p->head);
}

/* How far a measured pelvis, or measured hips, are from where the body has them. */
static vec3 pelvis_off(const body *b, const tracked *t) {
    if (t->has_position[PELVIS]) return sub(t->position[PELVIS], b->point[PELVIS]);
    vec3 off = vec(0, 0, 0);
    float count = 0.0F;
    for (int q = LEFT_HIP; q <= RIGHT_HIP; q++) {
        if (!t->has_position[q]) continue;
        off = add(off, sub(t->position[q], b->point[q]));
        count += 1.0F;
    }
    return count > 0.0F ? scale(off, 1.0F / count) : off;
}

static bool pelvis_seen(const tracked *t) {
    return t->has_position[PELVIS] || t->has_position[LEFT_HIP] || t->has_position[RIGHT_HIP];
}

/* Turn the neck so that a measured chest, whose rotation is known, is where it is below a measured head. */
static void turn_neck(body *b, const tracked *t) {
    if (!t->has_position[HEAD] || !t->has_position[SPINE3] || known_rotation(t, NECK)) return;
    vec3 neck = add(t->position[SPINE3], rotate(b->rotation[SPINE3], t->rest_offset[NECK]));
    vec3 before = sub(b->point[HEAD], b->point[NECK]);
    b->rotation[NECK] = turned_onto(b->rotation[NECK], before, sub(b->point[HEAD], neck));
    place(b, t, b->point[HEAD]);
}

/* Bend the spine so that the pelvis, which keeps its rotation, moves. Between the neck and the lowest joint of the spine
 * are two bones, of which the upper one is stiff; between a measured chest and that joint as well. */
static void bend_spine(body *b, const tracked *t, vec3 move) {
    if (dot(move, move) < 1e-12F) return;
    bool chest = t->has_position[SPINE3] || known_rotation(t, SPINE3);
    vec3 top = b->point[chest ? SPINE3 : NECK];
    vec3 upper = sub(b->point[SPINE2], top), lower = sub(b->point[SPINE1], b->point[SPINE2]);
    /* A spine that is straight bends backward. */
    vec3 side = along(upper, b->rotation[SPINE3].z, -SPINE_BACK * length(upper));
    two_bones to = reach(add(sub(b->point[SPINE1], top), move), length(upper), length(lower), side);
    if (!chest) b->rotation[SPINE3] = turned_onto(b->rotation[SPINE3], upper, to.middle);
    b->rotation[SPINE2] = turned_onto(b->rotation[SPINE2], upper, to.middle);
    b->rotation[SPINE1] = turned_onto(b->rotation[SPINE1], lower, sub(to.end, to.middle));
    place(b, t, b->point[HEAD]);
}

/* ---- arms and legs ----------------------------------------------------------------------------------------------- */

/* The heading that a lost limb goes along with: of the chest for arms, of the pelvis for legs. */
static void limb_heading(const body *b, int limb, float *c, float *s) {
    heading_of(b->rotation[is_leg(limb) ? PELVIS : SPINE3], c, s);
}

static uint8_t seen_by(const tracked *t, int limb) {
    if (t->has_position[LIMB[limb].end]) return 2;
    for (int k = 0; k < 5 && LIMB[limb].stand_in[k] >= 0; k++)
        if (t->has_position[LIMB[limb].stand_in[k]]) return 1;
    return 0;
}

/* The share of where a lost end was last seen, `lost` seconds later. */
static float kept_share(const limb_task *task, int limb, const limb_state *l) {
    float half = KEPT_LEG;
    if (!is_leg(limb)) {
        float raised = l->end_kept.y / (length(task->upper) + length(task->lower));
        float share = fminf(fmaxf((raised + 0.1F) / 0.4F, 0.0F), 1.0F);
        half = KEPT_ARM + (KEPT_RAISED - KEPT_ARM) * share;
    }
    float u = l->lost / half;
    return exp2f(-u * u / (1.0F + u) * 2.0F);
}

/* Ease a limb's task in the heading of the body. */
static void ease_limb(limb_task *task, const tracked *t, const bs_settings *settings, int limb, bool changed,
                      float c, float sine, bool begun, limb_state *l) {
    uint8_t seen = seen_by(t, limb);
    bool middle_seen = t->has_position[LIMB[limb].middle];
    vec3 end = into_heading(task->end, c, sine), middle = into_heading(task->middle, c, sine);
    bool found = begun && seen > l->seen, went = begun && seen < l->seen;
    if (went && seen == 0 && !middle_seen) {
        l->end_kept = l->end_output;
        l->middle_kept = l->middle_output;
        l->end_leaving = limited(l->end_speed, FASTEST);
        l->lost = 0.0F;
        l->end = l->middle = ease_begin(vec(0, 0, 0), 0.0F); /* what is kept is what was output, eased or not */
    }
    if (seen > 0 || middle_seen || !begun) l->lost = -1.0F;
    if (l->lost >= 0.0F) {
        l->lost += t->interval;
        float share = kept_share(task, limb, l);
        float gone = LEAVING * (1.0F - expf(-l->lost / LEAVING));
        end = mix(end, along(l->end_kept, l->end_leaving, gone), share);
        middle = mix(middle, along(l->middle_kept, l->end_leaving, 0.5F * gone), share);
    }
    float ease_seen = (float)settings->ease;
    bool end_breaks = found || (begun && seen != l->seen && l->lost < 0.0F) || (changed && seen == 0 && l->lost < 0.0F);
    bool middle_breaks = begun && (middle_seen != (l->middle_seen != 0) || (changed && !middle_seen && l->lost < 0.0F) || found);
    end = eased(&l->end, end, l->end_output, l->end_speed, t->interval, end_breaks,
                seen == 2 ? ease_seen : BLEND);
    middle = eased(&l->middle, middle, l->middle_output, l->middle_speed, t->interval, middle_breaks,
                   middle_seen ? ease_seen : BLEND);
    task->end = from_heading(end, c, sine);
    task->middle = from_heading(middle, c, sine);
    l->seen = seen;
    l->middle_seen = middle_seen;
}

/* Remember what a limb output, in the heading of the body. */
static void remember_limb(const body *b, int limb, float interval, bool begun, limb_state *l) {
    float c, s;
    limb_heading(b, limb, &c, &s);
    const limb_joints *j = &LIMB[limb];
    vec3 end = into_heading(sub(b->point[j->end], b->point[j->start]), c, s);
    vec3 middle = into_heading(sub(b->point[j->middle], b->point[j->start]), c, s);
    float rate = begun ? 1.0F / interval : 0.0F;
    l->end_speed = scale(sub(end, l->end_output), rate);
    l->middle_speed = scale(sub(middle, l->middle_output), rate);
    l->end_output = end;
    l->middle_output = middle;
}

/* Turn the bones of a limb as solved. Measured rotations stay. */
static void turn_limb(body *b, const tracked *t, int limb, two_bones to) {
    const limb_joints *j = &LIMB[limb];
    vec3 upper = rotate(b->rotation[j->start], t->rest_offset[j->middle]);
    vec3 lower = rotate(b->rotation[j->middle], t->rest_offset[j->end]);
    b->rotation[j->start] = turned_onto(b->rotation[j->start], upper, to.middle);
    b->rotation[j->middle] = turned_onto(b->rotation[j->middle], lower, sub(to.end, to.middle));
}

/* Where a shoulder goes: where it is measured, or where a measured elbow or a far wrist pulls it. From its collar, m. */
static vec3 pulled_shoulder(const tracked *t, int limb, vec3 collar, vec3 shoulder, const limb_task *task) {
    const limb_joints *j = &LIMB[limb];
    vec3 from = sub(shoulder, collar);
    if (known_rotation(t, j->carrier) || t->has_position[j->start]) return from;
    float size = length(from), upper = length(task->upper), lower = length(task->lower);
    vec3 pulled = from;
    if (task->middle_seen) {
        pulled = reach(add(from, task->middle), size, upper, from).middle;
        float doubt = SHOULDER_DOUBT * t->accuracy[j->middle];
        pulled = mix(from, pulled, 1.0F / (1.0F + doubt * doubt));
    } else if (task->end_seen) {
        float lacking = length(task->end) - LONGEST * (upper + lower);
        if (lacking > 0.0F) pulled = along(from, unit(task->end), lacking);
    }
    vec3 given = limited(sub(pulled, from), COLLAR_GIVES * size);
    return scale(unit(add(from, given)), size);
}

static void move_arm(body *b, const tracked *t, const mat3 goal[BODY_JOINTS], const bs_settings *settings, int limb,
                     bool changed, pose_state *s) {
    const limb_joints *j = &LIMB[limb];
    vec3 collar = b->point[j->carrier], shoulder = b->point[j->start], before = sub(shoulder, collar);
    if (t->has_position[j->start] && !known_rotation(t, j->carrier)) {
        float doubt = SHOULDER_DOUBT * t->accuracy[j->start];
        vec3 off = scale(sub(t->position[j->start], shoulder), 1.0F / (1.0F + doubt * doubt));
        shoulder = along(collar, unit(add(before, off)), length(before));
    }
    limb_task task = limb_goal(t, limb, goal, shoulder);
    float c, sine;
    limb_heading(b, limb, &c, &sine);
    ease_limb(&task, t, settings, limb, changed, c, sine, s->begun, &s->limb[limb]);
    vec3 pulled = add(collar, pulled_shoulder(t, limb, collar, shoulder, &task));
    vec3 given = sub(pulled, shoulder);
    task.end = sub(task.end, given);
    task.middle = sub(task.middle, given);
    b->rotation[j->carrier] = turned_onto(b->rotation[j->carrier], before, sub(pulled, collar));
    turn_limb(b, t, limb, solve_limb(&task));
}

/* How far the pelvis has to move for a leg whose measured knee or ankle it does not reach. */
static vec3 leg_lack(const limb_task *task) {
    float upper = length(task->upper), lower = length(task->lower);
    if (task->middle_seen) return sub(task->middle, scale(unit(task->middle), upper));
    float lacking = length(task->end) - LONGEST * (upper + lower);
    return task->end_seen && lacking > 0.0F ? scale(unit(task->end), lacking) : vec(0, 0, 0);
}

/* Move the pelvis by bending the spine. Measured joints of the legs stay where they are. */
static void move_pelvis(body *b, const tracked *t, limb_task task[2], vec3 move) {
    vec3 before = b->point[PELVIS];
    bend_spine(b, t, move);
    vec3 moved = sub(b->point[PELVIS], before);
    for (int k = 0; k < 2; k++) {
        if (task[k].end_seen) task[k].end = sub(task[k].end, moved);
        if (task[k].middle_seen) task[k].middle = sub(task[k].middle, moved);
    }
}

/* Move a pelvis that is not measured so that legs reach their measured joints. */
static void pull_pelvis(body *b, const tracked *t, pose_state *s, limb_task task[2]) {
    vec3 before = b->point[PELVIS];
    uint8_t pulling = 0;
    for (int k = 0; k < 2; k++)
        if (!pelvis_seen(t)) pulling |= (uint8_t)((task[k].middle_seen ? 1 : 0) + (task[k].end_seen ? 2 : 0)) << 2 * k;
    for (int round = 0; round < PULLS && pulling != 0; round++) {
        vec3 lack = vec(0, 0, 0);
        float count = 0.0F;
        for (int k = 0; k < 2; k++) {
            if (!task[k].middle_seen && !task[k].end_seen) continue;
            lack = add(lack, leg_lack(&task[k]));
            count += 1.0F;
        }
        vec3 moved = sub(b->point[PELVIS], before);
        move_pelvis(b, t, task, sub(limited(along(moved, lack, 1.0F / count), MOST_MOVED), moved));
    }
    vec3 moved = sub(b->point[PELVIS], before);
    bool breaks = s->begun && pulling != s->pulling;
    vec3 shown = eased(&s->pull, moved, s->pulled, vec(0, 0, 0), t->interval, breaks, BLEND);
    move_pelvis(b, t, task, sub(shown, moved));
    s->pulling = pulling;
    s->pulled = sub(b->point[PELVIS], before);
}

static float rest_height(const tracked *t, int point) {
    float height = 0.0F;
    for (int p = point; p >= 0; p = PARENT[p]) height += t->rest_offset[p].y;
    return height;
}

/* 1 if the body stands or walks, 0 if it sits, lies or jumps. */
static float uprightness(const body *b, const tracked *t, const pose_state *s) {
    float tall = rest_height(t, HEAD), high = b->point[HEAD].y - t->floor;
    float risen = fminf(fmaxf((high / tall - 0.75F) / 0.1F, 0.0F), 1.0F);
    float calm = fminf(fmaxf((STEADY - fabsf(s->head_speed.y)) / (0.5F * STEADY), 0.0F), 1.0F);
    return high > tall + 0.03F ? 0.0F : risen * calm;
}

/* Draw a foot that stands, and that its leg does not reach, in below its hip, so that it stays on the floor. */
static vec3 drawn_in(vec3 hip, vec3 ankle, float longest) {
    vec3 away = vec(ankle.x - hip.x, 0, ankle.z - hip.z);
    float high = hip.y - ankle.y, far = length(away);
    float square = longest * longest - high * high;
    if (square >= far * far) return vec(0, 0, 0);
    float nearest = sqrtf(fmaxf(square, 0.0F));
    return limited(scale(away, nearest / fmaxf(far, 1e-6F) - 1.0F), MOST_DRAWN);
}

/* How much lower the pelvis must be for a leg to reach its ankle (m). */
static float lacking_height(vec3 hip, vec3 ankle, float longest) {
    float away = (ankle.x - hip.x) * (ankle.x - hip.x) + (ankle.z - hip.z) * (ankle.z - hip.z);
    float square = longest * longest - away;
    return square > 0.0F ? fmaxf(hip.y - ankle.y - sqrtf(square), 0.0F) : 0.0F;
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

static void move_legs(body *b, const tracked *t, const prediction *p, const mat3 goal[BODY_JOINTS],
                      const bs_settings *settings, const bool changed[GROUPS], pose_state *s) {
    limb_task task[2];
    float c, sine;
    for (int k = 0; k < 2; k++) task[k] = limb_goal(t, LEFT_LEG + k, goal, b->point[LEFT_HIP + k]);
    pull_pelvis(b, t, s, task);
    limb_heading(b, LEFT_LEG, &c, &sine);
    foot feet[2];
    for (int k = 0; k < 2; k++) {
        const limb_joints *j = &LIMB[LEFT_LEG + k];
        ease_limb(&task[k], t, settings, LEFT_LEG + k, changed[LEFT_LEG + k], c, sine, s->begun, &s->limb[LEFT_LEG + k]);
        two_bones to = solve_limb(&task[k]);
        int ball = LEFT_FOOT + k, toe = LEFT_TOE + k;
        foot *f = &feet[k];
        f->ankle = add(b->point[j->start], to.end);
        f->ankle_rest = rest_height(t, j->end);
        f->ball_rest = rest_height(t, ball);
        flatten_foot(b, t, j->end, ball, f->ankle_rest - f->ball_rest, flatness(&s->foot[k]));
        f->ball = add(f->ankle, rotate(b->rotation[j->end], t->rest_offset[ball]));
        f->toe = add(f->ball, rotate(b->rotation[ball], t->rest_offset[toe]));
        f->ankle_contact = p->contact[k];
        f->ball_contact = p->contact[2 + k];
        f->seen = t->has_position[j->end] || t->has_position[ball] || t->has_position[toe];
    }
    vec3 move[2] = {{0, 0, 0}, {0, 0, 0}};
    if (settings->hold_feet) hold_feet(feet, t->floor, t->interval, uprightness(b, t, s), s->foot, move);
    float lacking = 0.0F, settle = 1.0F - exp2f(-t->interval / SETTLE);
    for (int k = 0; k < 2; k++) {
        if (s->foot[k].held == 0) continue;
        float longest = LONGEST * (length(task[k].upper) + length(task[k].lower));
        vec3 ankle = add(feet[k].ankle, move[k]);
        vec3 drawn = scale(drawn_in(b->point[LEFT_HIP + k], ankle, longest), settle);
        s->foot[k].anchor = add(s->foot[k].anchor, drawn); /* it stays there */
        s->foot[k].slide = add(s->foot[k].slide, drawn);
        move[k] = add(move[k], drawn);
        ankle = add(ankle, drawn);
        lacking = fmaxf(lacking, lacking_height(b->point[LEFT_HIP + k], ankle, longest));
    }
    if (pelvis_seen(t)) lacking = 0.0F;
    s->standing_drop += settle * (fminf(lacking, MOST_MOVED) - s->standing_drop);
    vec3 pelvis = b->point[PELVIS];
    bend_spine(b, t, vec(0, -s->standing_drop, 0));
    vec3 moved = sub(b->point[PELVIS], pelvis);
    for (int k = 0; k < 2; k++) {
        /* Feet stay where they are when the pelvis is lowered for them. */
        vec3 shift = sub(move[k], moved);
        task[k].end = add(task[k].end, shift);
        if (task[k].middle_seen) task[k].middle = sub(task[k].middle, moved);
        turn_limb(b, t, LEFT_LEG + k, solve_limb(&task[k]));
    }
}

/* The heading of the chest as a rotation. */
static mat3 chest_heading(const body *b) {
    float c, s;
    heading_of(b->rotation[SPINE3], &c, &s);
    return (mat3){{c, 0, -s}, {0, 1, 0}, {s, 0, c}};
}

/* A wrist whose rotation is lost keeps it to the chest, and gives it up slowly. */
static void keep_wrists(body *b, const tracked *t, pose_state *s) {
    for (int k = 0; k < 2; k++) {
        int wrist = LEFT_WRIST + k;
        if (known_rotation(t, wrist)) {
            s->wrist_lost[k] = 0.0F;
            continue;
        }
        if (s->wrist_lost[k] < 0.0F) continue;
        s->wrist_lost[k] += t->interval;
        float u = s->wrist_lost[k] / KEPT_WRIST;
        vec3 turn = turn_between(b->rotation[wrist], product(chest_heading(b), s->wrist_kept[k]));
        b->rotation[wrist] = turned_by(b->rotation[wrist], scale(turn, (1.0F + u) * expf(-u)));
    }
}

/* ---- the whole --------------------------------------------------------------------------------------------------- */

void pose_start(pose_state *s) {
    memset(s, 0, sizeof *s);
    for (int k = 0; k < LIMBS; k++) s->limb[k].lost = -1.0F;
    for (int k = 0; k < 2; k++) s->wrist_lost[k] = -1.0F;
}

void pose_read(const pose_state *s, tracked *t) {
    imply_rotations(t);
    place_head(t, s->begun ? s->point : NULL);
}

void pose_body(const bs_settings *settings, const tracked *t, const prediction *p, pose_state *s, body *out) {
    bool changed[GROUPS], begun = s->begun;
    mat3 goal[BODY_JOINTS];
    float interval = t->interval;
    find_changes(t, s, changed);
    rotation_goals(t, p, goal);
    for (int j = 0; j < BODY_JOINTS; j++) {
        bool known = known_rotation(t, j), came = begun && known != (s->had_rotation[j] != 0);
        bool wrist = j == LEFT_WRIST || j == RIGHT_WRIST;
        bool breaks = wrist ? came && known : came || (changed[GROUP[j]] && !known);
        float span = known ? (float)settings->ease : BLEND;
        out->rotation[j] = eased_turn(&s->turn[j], goal[j], s->rotation[j], s->spin[j], interval, breaks, span);
    }

    /* The body hangs on its head, or on its pelvis, or on what is seen. */
    place(out, t, p->head);
    vec3 head = add(p->head, placement(out, t, p));
    bool head_breaks = begun && (t->has_position[HEAD] != (s->had_position[HEAD] != 0) ||
                                 (!t->has_position[HEAD] && (changed[TRUNK] || changed[LEFT_ARM] || changed[RIGHT_ARM])));
    head = eased(&s->head, head, s->point[HEAD], s->head_speed, interval, head_breaks,
                 t->has_position[HEAD] ? (float)settings->ease : BLEND);
    place(out, t, head);

    turn_neck(out, t);

    /* The spine bends to a measured pelvis. */
    bool pelvis_breaks = begun && (pelvis_seen(t) != (s->had_position[PELVIS] || s->had_position[LEFT_HIP] ||
                                                      s->had_position[RIGHT_HIP]) ||
                                   t->has_position[PELVIS] != (s->had_position[PELVIS] != 0));
    vec3 wanted = add(out->point[PELVIS], pelvis_off(out, t));
    wanted = eased(&s->pelvis, wanted, s->point[PELVIS], s->pelvis_speed, interval, pelvis_breaks,
                   pelvis_seen(t) ? (float)settings->ease : BLEND);
    bend_spine(out, t, sub(wanted, out->point[PELVIS]));

    /* Legs first: the pelvis may be moved for them, and the chest with it. */
    move_legs(out, t, p, goal, settings, changed, s);
    move_arm(out, t, goal, settings, LEFT_ARM, changed[LEFT_ARM], s);
    move_arm(out, t, goal, settings, RIGHT_ARM, changed[RIGHT_ARM], s);
    keep_wrists(out, t, s);
    place(out, t, head);
}

void pose_finish(const tracked *t, pose_state *s, body *out, float off[BS_POINTS]) {
    place_points(out, t->rest_offset, HEAD, out->point[HEAD], BS_POINTS);
    float rate = s->begun ? 1.0F / t->interval : 0.0F;
    s->head_speed = scale(sub(out->point[HEAD], s->point[HEAD]), rate);
    s->pelvis_speed = scale(sub(out->point[PELVIS], s->point[PELVIS]), rate);
    for (int k = 0; k < LIMBS; k++) remember_limb(out, k, t->interval, s->begun, &s->limb[k]);
    for (int j = 0; j < BODY_JOINTS; j++) {
        s->spin[j] = scale(turn_between(s->rotation[j], out->rotation[j]), rate);
        s->rotation[j] = out->rotation[j];
        s->had_rotation[j] = known_rotation(t, j);
    }
    for (int k = 0; k < 2; k++)
        if (known_rotation(t, LEFT_WRIST + k))
            s->wrist_kept[k] = product(transpose(chest_heading(out)), out->rotation[LEFT_WRIST + k]);
    for (int p = 0; p < BS_POINTS; p++) {
        s->point[p] = out->point[p];
        s->had_position[p] = t->has_position[p];
        off[p] = t->has_position[p] ? distance(t->position[p], out->point[p]) : 0.0F;
    }
    s->begun = 1;
}
