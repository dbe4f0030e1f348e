/* The body's network: evaluated on the tracked points and on their mirror image; the outputs are averaged. */
#include "network.h"

#include <string.h>

#include "features.h"
#include "layers.h"
#include "../constants.h"

size_t network_memory(const bs_model *model) {
    return sizeof(input_memory) / sizeof(float) +
           2 * ((size_t)model->layers * (size_t)model->hidden + (size_t)model->hand_hidden);
}

void network_start(const bs_model *model, float *memory) {
    memset(memory, 0, network_memory(model) * sizeof *memory);
    ((input_memory *)(void *)memory)->cosine = 1.0F;
}

/* Scratch of the body's network. */
typedef struct body_scratch {
    float *features; /* columns × features */
    float *state;    /* layers × columns × hidden, after this frame */
    float *before;   /* columns × hidden */
    inputs features_in, state_in;
    float *turned, *judged; /* columns × outputs */
    reading *read;
    float *updated; /* columns: 1 where the head's pose is not tracked, else 0 */
    workspace work;
} body_scratch;

static body_scratch scratch_of(const bs_model *m, scratch *s, int people) {
    const int columns = 2 * people, turn = m->turn.of_hidden.rows, judge = m->judge.of_hidden.rows;
    body_scratch b;
    b.features = floats_of(s, columns, m->features);
    b.state = floats_of(s, columns, m->layers * m->hidden);
    b.before = floats_of(s, columns, m->hidden);
    b.features_in = inputs_of(m, s, columns, m->features, FEATURE_STEPS);
    b.state_in = inputs_of(m, s, columns, m->hidden, STATE_STEPS);
    b.turned = floats_of(s, columns, grouped(TURNED));
    b.judged = floats_of(s, columns, grouped(JUDGED));
    b.read = part_of(s, (size_t)people * sizeof *b.read);
    b.updated = floats_of(s, columns, 1);
    b.work = workspace_of(m, s, columns, m->hidden, turn > judge ? turn : judge);
    return b;
}

size_t network_scratch(const bs_model *model, int people) {
    scratch s = {NULL, 0};
    scratch_of(model, &s, people < TOGETHER ? people : TOGETHER);
    const size_t fingers = finger_scratch(model, people);
    return s.used > fingers ? s.used : fingers;
}

/* A joint's rotation in the frame under the head: the mean of the outputs for a body and for its mirror image. `unlike`
 * is how much the axes of the two differ. */
static mat3 turned_joint(const bs_model *m, const float *own, const float *image, int joint, float *unlike) {
    static const float SIGN[6] = {1, -1, -1, 1, -1, 1};
    float part[6]; /* component by component: of the x axis, of the y axis */
    float square = LEAST_UNLIKE * LEAST_UNLIKE;
    for (int k = 0; k < 6; k++) {
        const float mirrored = SIGN[k] * image[6 * PARTNER[joint] + k], half = 0.5F * (own[6 * joint + k] - mirrored);
        part[k] = m->standing[6 * joint + k] + 0.5F * (own[6 * joint + k] + mirrored);
        square += half * half;
    }
    *unlike = sqrtf(square);
    return frame_of(vec(part[0], part[2], part[4]), vec(part[1], part[3], part[5]));
}

/* Combine the outputs for a body and for its mirror image. */
static void predict(const bs_model *m, const reading *read, head_frame frame, const float *turned,
                    const float *judged, prediction *out) {
    const float *image = turned + grouped(TURNED), *image_judged = judged + grouped(JUDGED);
    for (int joint = 0; joint < BODY_JOINTS; joint++) {
        const mat3 mean = turned_joint(m, turned, image, joint, &out->unlike[joint]);
        out->rotation[joint] = (mat3){from_frame(frame, mean.x), from_frame(frame, mean.y), from_frame(frame, mean.z)};
    }

    const float *head = turned + 6 * BODY_JOINTS, *image_head = image + 6 * BODY_JOINTS;
    const vec3 raised = vec(0.5F * (head[0] - image_head[0]), REFERENCE_HEAD + 0.5F * (head[1] + image_head[1]),
                            0.5F * (head[2] + image_head[2]));
    out->head = add(frame.origin, scale(from_frame(frame, raised), read->size));
    for (int k = 0; k < BS_CONTACTS; k++) out->contact[k] = logistic(0.5F * (judged[k] + image_judged[k ^ 1]));
    for (int k = 0; k < BODY_POINTS; k++) {
        const int joint = BODY_POINT[k] < BODY_JOINTS;
        const int partner = joint ? PARTNER[k] : k == BODY_POINTS - 3 ? k : 2 * BODY_POINTS - 3 - k; /* toes */
        const float raw = 0.5F * (judged[BS_CONTACTS + k] + image_judged[BS_CONTACTS + partner]);
        out->error[k] = (softplus(raw + BODY_ERROR_BIAS) + BODY_LEAST_ERROR) * read->size;
    }
}

static void remember(const tracked *seen, const reading *read, input_memory *to) {
    static const signed char JOINT[SPINNING] = {HEAD, LEFT_WRIST, RIGHT_WRIST};
    for (int k = 0; k < READ_POINTS; k++) {
        to->place[k] = read->place[k];
        to->had_place[k] = read->has_place[k] ? 1.0F : 0.0F;
    }
    for (int k = 0; k < SPINNING; k++) {
        to->axis[k][0] = seen->rotation[JOINT[k]].x;
        to->axis[k][1] = seen->rotation[JOINT[k]].y;
        to->had_axes[k] = read->has_axes[JOINT[k]] ? 1.0F : 0.0F;
    }
}

static void predict_together(const bs_model *m, int people, const tracked *seen, head_frame *frame,
                             float *const *memory, prediction *out, scratch s) {
    const int columns = 2 * people;
    const size_t hidden = (size_t)m->hidden, size = (size_t)m->layers * hidden;
    body_scratch b = scratch_of(m, &s, people);
    bool any_updated = false;
    for (int p = 0; p < people; p++) {
        const input_memory *last = (const input_memory *)(const void *)memory[p];
        frame[p] = find_frame(&seen[p], last);
        b.read[p] = read_person(&seen[p], last);
        const bool tracked_head = b.read[p].has_place[HEAD] && b.read[p].has_axes[HEAD];
        b.updated[2 * p] = b.updated[2 * p + 1] = tracked_head ? 0.0F : 1.0F;
        any_updated = any_updated || !tracked_head;
        for (int image = 0; image < 2; image++)
            write_features(m, &seen[p], &b.read[p], frame[p], last, image == 1,
                           b.features + (size_t)(2 * p + image) * (size_t)m->features);
    }
    if (any_updated) b.work.updated = b.updated;
    quantise_columns(m, columns, b.features, m->features, b.features_in);
    for (int layer = 0; layer < m->layers; layer++) {
        float *after = b.state + (size_t)layer * (size_t)columns * hidden;
        for (int c = 0; c < columns; c++)
            memcpy(b.before + (size_t)c * hidden,
                   hidden_of(memory[c / 2]) + (size_t)(c % 2) * size + (size_t)layer * hidden, hidden * sizeof(float));
        run_recurrent(m, &m->layer[layer], columns, layer ? b.state_in : b.features_in, b.before, after, b.work);
        quantise_columns(m, columns, after, m->hidden, b.state_in);
    }
    run_branch(m, &m->turn, columns, b.state_in, b.features_in, b.turned, b.work);
    run_branch(m, &m->judge, columns, b.state_in, b.features_in, b.judged, b.work);
    for (int p = 0; p < people; p++) {
        input_memory *own = (input_memory *)(void *)memory[p];
        predict(m, &b.read[p], frame[p], b.turned + 2 * p * grouped(TURNED),
                b.judged + 2 * p * grouped(JUDGED), &out[p]);
        own->cosine = frame[p].cosine, own->sine = frame[p].sine;
        own->elapsed = b.read[p].interval;
        own->advances = own->begun < 0.5F || own->elapsed >= MEMORY_INTERVAL ? 1.0F : 0.0F;
        if (own->advances < 0.5F) continue;
        remember(&seen[p], &b.read[p], own);
        for (int layer = 0; layer < m->layers; layer++) {
            for (int image = 0; image < 2; image++)
                memcpy(hidden_of(memory[p]) + (size_t)image * size + (size_t)layer * hidden,
                       b.state + ((size_t)layer * (size_t)columns + (size_t)(2 * p + image)) * hidden,
                       hidden * sizeof(float));
        }
    }
}

void predict_bodies(const bs_model *model, int people, const tracked *seen, head_frame *frame, float *const *memory,
                    prediction *out, void *scratch_memory) {
    for (int first = 0; first < people; first += TOGETHER) {
        const int count = people - first < TOGETHER ? people - first : TOGETHER;
        predict_together(model, count, seen + first, frame + first, memory + first, out + first,
                         (scratch){scratch_memory, 0});
    }
}
