/* Fingers: one network for both hands, each in its wrist's frame, the right one in a mirror; then what is measured. */
#include <string.h>

#include "../constants.h"
#include "features.h"
#include "layers.h"
#include "network.h"

#define SMALLEST_HAND 1e-3F   /* m, from wrist to middle finger */
#define LEAST_DOUBT 1e-6F     /* m, of a measured direction */
#define MIDDLE 3              /* of a hand's points: the first joint of the middle finger */

/* A hand: its wrist, and the points of it, joints first. */
static int wrist_of(int hand) { return hand ? RIGHT_WRIST : LEFT_WRIST; }

static int point_of(int hand, int k) {
    return k < HAND_JOINTS ? (hand ? RIGHT_INDEX1 : LEFT_INDEX1) + k
                           : (hand ? RIGHT_INDEX_TIP : LEFT_INDEX_TIP) + 2 * (k - HAND_JOINTS);
}

static vec3 flipped(vec3 v, int hand) { return hand ? reflected(v) : v; }

/* Features of a hand; those of the right one in a mirror, where an x axis keeps pointing outward. */
static void write_hand(const bs_model *m, const tracked *seen, head_frame frame, const body *now,
                       const input_memory *last, int hand, float *out) {
    const int wrist = wrist_of(hand);
    const mat3 turn = now->rotation[wrist];
    const float x_sign = hand ? -1.0F : 1.0F;
    const float size = length(seen->rest_offset[point_of(hand, MIDDLE)]);
    const float larger = 1.0F / (size > SMALLEST_HAND ? size : SMALLEST_HAND);
    const vec3 none = vec(0, 0, 0);

    for (int k = 0; k < HAND_POINTS; k++) {
        const int point = point_of(hand, k);
        const bool has = seen->has_position[wrist] && seen->has_position[point];
        const vec3 v = has ? rotate_back(turn, sub(seen->position[point], seen->position[wrist])) : none;
        out = put(out, flipped(scale(v, larger), hand));
    }
    for (int k = 0; k < HAND_POINTS; k++)
        *out++ = seen->has_position[wrist] && seen->has_position[point_of(hand, k)] ? 1.0F : 0.0F;
    for (int k = 0; k < HAND_JOINTS; k++) {
        const int joint = point_of(hand, k);
        const mat3 local = seen->has_rotation[joint] ? product(transpose(turn), seen->rotation[joint])
                                                     : (mat3){none, none, none};
        out = put_axes(out, scale(flipped(local.x, hand), x_sign), flipped(local.y, hand));
    }
    for (int k = 0; k < HAND_JOINTS; k++) *out++ = seen->has_rotation[point_of(hand, k)] ? 1.0F : 0.0F;
    for (int k = 0; k < HAND_POINTS; k++) {
        const float *usual = m->usual_fingers + (size_t)(3 * k); /* of a left hand */
        const vec3 bone = flipped(scale(seen->rest_offset[point_of(hand, k)], larger), hand);
        out = put(out, scale(sub(bone, vec(usual[0], usual[1], usual[2])), HAND_BONE_SCALE));
    }
    const vec3 velocity = scale(sub(now->point[wrist], last->wrist[hand]), last->begun / seen->interval);
    const vec3 place = to_frame(frame, sub(now->point[wrist], now->point[HEAD]));
    out = put(out, flipped(clamped(place, HAND_FASTEST), hand));
    out = put(out, flipped(clamped(to_frame(frame, velocity), HAND_FASTEST), hand));
    out = put_axes(out, scale(flipped(to_frame(frame, turn.x), hand), x_sign), flipped(to_frame(frame, turn.y), hand));
    *out = USUAL_RATE * last->elapsed;
}

/* The smallest turn that takes the direction `from` onto `to`, applied to a rotation; opposite directions leave it. */
static mat3 turned_onto(mat3 m, vec3 from, vec3 to) {
    const vec3 begin = unit(from), middle = unit(add(begin, unit(to)));
    if (dot(middle, middle) < 0.5F) return m;
    vec3 *axis[3] = {&m.x, &m.y, &m.z};
    for (int k = 0; k < 3; k++) { /* two reflections make a turn */
        *axis[k] = along(*axis[k], begin, -2.0F * dot(*axis[k], begin));
        *axis[k] = along(*axis[k], middle, -2.0F * dot(*axis[k], middle));
    }
    return m;
}

/* Turn a joint to point at its measured child; less if their errors are comparable to their distance. */
static mat3 directed(const tracked *seen, int joint, int child, mat3 m) {
    if (!seen->has_position[joint] || !seen->has_position[child]) return m;
    const vec3 rest = seen->rest_offset[child], bone = rotate(m, rest);
    const float square = dot(rest, rest);
    const float doubt = 2.0F * (seen->accuracy[joint] + seen->accuracy[child]) + LEAST_DOUBT;
    const float trust = square / (square + doubt * doubt);
    return turned_onto(m, bone, mix(bone, sub(seen->position[child], seen->position[joint]), trust));
}

/* Rotations, places and expected errors of a hand from the network's outputs. */
static void place_hand(const bs_model *m, const tracked *seen, int hand, const float *output, body *out,
                       float *error) {
    const mat3 wrist = out->rotation[wrist_of(hand)];
    for (int k = 0; k < HAND_JOINTS; k++) {
        const float *part = output + 6 * k, *usual = m->relaxed + 6 * k;
        const vec3 x = vec(part[0] + usual[0], part[2] + usual[2], part[4] + usual[4]);
        const vec3 y = vec(part[1] + usual[1], part[3] + usual[3], part[5] + usual[5]);
        const vec3 outward = hand ? scale(reflected(x), -1.0F) : x;
        const mat3 turn = product(wrist, frame_of(outward, flipped(y, hand)));
        const int joint = point_of(hand, k), child = k % 3 < 2 ? joint + 1 : point_of(hand, HAND_JOINTS + k / 3);
        out->rotation[joint] = seen->has_rotation[joint] ? seen->rotation[joint] : directed(seen, joint, child, turn);
    }
    for (int k = 0; k < HAND_POINTS; k++) {
        const int point = point_of(hand, k), parent = PARENT[point];
        out->point[point] = add(out->point[parent], rotate(out->rotation[parent], seen->rest_offset[point]));
        error[k] = softplus(output[6 * HAND_JOINTS + k] + FINGER_ERROR_BIAS) + FINGER_LEAST_ERROR;
    }
}

/* Scratch of the finger network. */
typedef struct hand_scratch {
    float *features, *before, *after, *output;
    inputs features_in, after_in;
    workspace work;
} hand_scratch;

static hand_scratch scratch_of(const bs_model *m, scratch *s, int people) {
    const int columns = 2 * people;
    hand_scratch h;
    h.features = floats_of(s, columns, m->hand_features);
    h.before = floats_of(s, columns, m->hand_hidden);
    h.after = floats_of(s, columns, m->hand_hidden);
    h.output = floats_of(s, columns, grouped(HAND_OUTPUTS));
    h.features_in = inputs_of(m, s, columns, m->hand_features, FEATURE_STEPS);
    h.after_in = inputs_of(m, s, columns, m->hand_hidden, STATE_STEPS);
    h.work = workspace_of(m, s, columns, m->hand_hidden, m->fingers.of_hidden.rows);
    return h;
}

size_t finger_scratch(const bs_model *model, int people) {
    scratch s = {NULL, 0};
    scratch_of(model, &s, people < TOGETHER ? people : TOGETHER);
    return s.used;
}

static void complete_together(const bs_model *m, int people, const tracked *seen, const head_frame *frame, body *out,
                              float *const *memory, float (*finger_error)[2 * HAND_POINTS], scratch s) {
    const int columns = 2 * people;
    const size_t hidden = (size_t)m->hand_hidden, others = 2 * (size_t)m->layers * (size_t)m->hidden;
    hand_scratch h = scratch_of(m, &s, people);
    for (int c = 0; c < columns; c++) {
        const int p = c / 2, hand = c % 2;
        const input_memory *last = (const input_memory *)(const void *)memory[p];
        write_hand(m, &seen[p], frame[p], &out[p], last, hand, h.features + c * m->hand_features);
        memcpy(h.before + (size_t)c * hidden, hidden_of(memory[p]) + others + (size_t)hand * hidden,
               hidden * sizeof(float));
    }
    quantise_columns(m, columns, h.features, m->hand_features, h.features_in);
    run_recurrent(m, &m->hands, columns, h.features_in, h.before, h.after, h.work);
    quantise_columns(m, columns, h.after, m->hand_hidden, h.after_in);
    run_branch(m, &m->fingers, columns, h.after_in, h.features_in, h.output, h.work);
    for (int p = 0; p < people; p++) {
        input_memory *own = (input_memory *)(void *)memory[p];
        for (int hand = 0; hand < 2; hand++)
            place_hand(m, &seen[p], hand, h.output + (2 * p + hand) * grouped(HAND_OUTPUTS), &out[p],
                       finger_error[p] + hand * HAND_POINTS);
        if (own->advances > 0.5F) {
            memcpy(hidden_of(memory[p]) + others, h.after + (size_t)(2 * p) * hidden, 2 * hidden * sizeof(float));
            own->elapsed = 0;
        }
        own->begun = 1.0F;
        for (int hand = 0; hand < 2; hand++) own->wrist[hand] = out[p].point[wrist_of(hand)];
    }
}

void complete_fingers(const bs_model *model, int people, const tracked *seen, const head_frame *frame, body *out,
                      float *const *memory, float (*finger_error)[2 * HAND_POINTS], void *scratch_memory) {
    for (int first = 0; first < people; first += TOGETHER) {
        const int count = people - first < TOGETHER ? people - first : TOGETHER;
        complete_together(model, count, seen + first, frame + first, out + first, memory + first, finger_error + first,
                          (scratch){scratch_memory, 0});
    }
}
