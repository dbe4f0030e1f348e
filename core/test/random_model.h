/* A tiny model with random weights and an average body, as a file in memory: tests and fuzzing need no training. */
#ifndef BODYSENSE_RANDOM_MODEL_H
#define BODYSENSE_RANDOM_MODEL_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../src/network/model.h"

#define TINY_HIDDEN 32
#define TINY_HAND 16
#define TINY_BRANCH 48
#define TINY_RANK 16
#define HEADER_ROOM 16384
#define DATA_ROOM 1048576

/* A generator of random numbers (xorshift64*), equal on all platforms. */
typedef struct source_of_numbers {
    uint64_t state;
} source_of_numbers;

static inline uint32_t random_bits(source_of_numbers *from) {
    from->state ^= from->state >> 12;
    from->state ^= from->state << 25;
    from->state ^= from->state >> 27;
    return (uint32_t)((from->state * 0x2545F4914F6CDD1DU) >> 32);
}

static inline bool chance(source_of_numbers *from, double share) {
    return random_bits(from) < (uint32_t)(share * 4294967295.0);
}

/* A number between two others, in multiples of 2^-20 of their distance. */
static inline double between(source_of_numbers *from, double low, double high) {
    return low + (high - low) * (double)(random_bits(from) >> 12) / 1048576.0;
}

/* Rest offsets (m) of an average adult, in millimetres: left side and middle; the right side is the mirror image. */
static inline void average_body(double offset[BS_POINTS][3]) {
    static const short LEFT[][4] = {
        {PELVIS, 0, 991, 0},        {LEFT_HIP, 107, -88, -8},      {SPINE1, 0, 68, -22},       {LEFT_KNEE, 0, -407, 0},
        {SPINE2, 0, 79, 1},         {LEFT_ANKLE, 0, -420, 0},      {SPINE3, 0, 134, -11},      {LEFT_FOOT, -5, -48, 143},
        {NECK, 0, 181, 29},         {LEFT_COLLAR, 23, 110, 47},    {HEAD, 0, 96, 32},          {LEFT_SHOULDER, 148, -21, -4},
        {LEFT_ELBOW, 261, 0, 0},    {LEFT_WRIST, 233, 0, 0},       {LEFT_INDEX1, 105, -4, 26}, {LEFT_INDEX2, 27, 0, 0},
        {LEFT_INDEX3, 24, 0, 0},    {LEFT_MIDDLE1, 104, 0, 0},     {LEFT_MIDDLE2, 34, 0, 0},   {LEFT_MIDDLE3, 28, 0, 0},
        {LEFT_PINKY1, 88, -4, -38}, {LEFT_PINKY2, 22, 0, 0},       {LEFT_PINKY3, 16, 0, 0},    {LEFT_RING1, 98, 0, -20},
        {LEFT_RING2, 30, 0, 0},     {LEFT_RING3, 25, 0, 0},        {LEFT_THUMB1, 38, -4, 24},  {LEFT_THUMB2, 12, -21, 20},
        {LEFT_THUMB3, 26, -18, 19}, {HEAD_TOP, 0, 145, 13},        {LEFT_TOE, 0, -13, 56},     {LEFT_INDEX_TIP, 27, 0, 0},
        {LEFT_MIDDLE_TIP, 26, 0, 0}, {LEFT_PINKY_TIP, 21, 0, 0},   {LEFT_RING_TIP, 28, 0, 0},  {LEFT_THUMB_TIP, 25, -15, 4}};
    for (size_t k = 0; k < sizeof LEFT / sizeof *LEFT; k++) {
        for (int side = 0; side < 2; side++) {
            double *to = offset[side ? PARTNER[LEFT[k][0]] : LEFT[k][0]];
            for (int c = 0; c < 3; c++) to[c] = LEFT[k][c + 1] / 1000.0;
            if (side) to[0] = -to[0];
        }
    }
}

/* A safetensors file that is being written. */
typedef struct model_writer {
    source_of_numbers random;
    char *header, *data;
    size_t header_size, data_size;
} model_writer;

/* Describe a tensor of `count` numbers of `bytes` each, and return the place of its numbers. */
static inline void *tensor_of(model_writer *w, const char *name, const char *type, int rows, int columns, size_t bytes) {
    const size_t size = (size_t)rows * (size_t)columns * bytes;
    void *at = w->data + w->data_size;
    w->header_size += (size_t)snprintf(w->header + w->header_size, HEADER_ROOM - w->header_size,
                                       ",\"%s\":{\"dtype\":\"%s\",\"shape\":[%d,%d],\"data_offsets\":[%zu,%zu]}", name, type,
                                       rows, columns, w->data_size, w->data_size + size);
    w->data_size += (size + 7) / 8 * 8;
    return at;
}

static inline void random_floats(model_writer *w, const char *name, int rows, int columns, double size) {
    float *to = tensor_of(w, name, "F32", rows, columns, sizeof *to);
    for (int k = 0; k < rows * columns; k++) to[k] = (float)between(&w->random, -size, size);
}

/* Weights in bytes, with a step of each row. */
static inline void random_bytes(model_writer *w, const char *name, int rows, int columns) {
    char step_name[80];
    int8_t *to = tensor_of(w, name, "I8", rows, columns, 1);
    for (int k = 0; k < rows * columns; k++) to[k] = (int8_t)((int)(random_bits(&w->random) % 255) - 127);
    snprintf(step_name, sizeof step_name, "%s.step", name);
    float *step = tensor_of(w, step_name, "F32", rows, 1, sizeof *step);
    for (int k = 0; k < rows; k++) step[k] = (float)between(&w->random, 0.25, 1.0) / (127.0F * 4.0F);
}

static inline void random_recurrent(model_writer *w, const char *network, int layer, int inputs, int hidden) {
    static const char *const PART[] = {"weight_ih", "weight_hh", "bias_ih", "bias_hh"};
    for (int k = 0; k < 4; k++) {
        char name[64];
        snprintf(name, sizeof name, "%s.recurrent.%s_l%d", network, PART[k], layer);
        if (k < 2) random_bytes(w, name, 3 * hidden, k ? hidden : inputs);
        else random_floats(w, name, 3 * hidden, 1, 0.5);
    }
}

/* The updates of a product, of rank `TINY_RANK`. */
static inline void random_update(model_writer *w, const char *product, int inputs, int outputs) {
    char name[64];
    snprintf(name, sizeof name, "body.updates.%s.0.weight", product), random_bytes(w, name, TINY_RANK, inputs);
    snprintf(name, sizeof name, "body.updates.%s.1.weight", product), random_bytes(w, name, outputs, TINY_RANK);
}

static inline void random_branch(model_writer *w, const char *branch, int inputs, int outputs) {
    char name[64];
    snprintf(name, sizeof name, "%s.0.weight", branch), random_bytes(w, name, TINY_BRANCH, inputs);
    snprintf(name, sizeof name, "%s.0.bias", branch), random_floats(w, name, TINY_BRANCH, 1, 0.5);
    snprintf(name, sizeof name, "%s.2.weight", branch), random_floats(w, name, outputs, TINY_BRANCH, 0.02);
    snprintf(name, sizeof name, "%s.2.bias", branch), random_floats(w, name, outputs, 1, 0.02);
}

/* Axes of joints that are not turned. */
static inline void upright_axes(model_writer *w, const char *name, int joints) {
    float *to = tensor_of(w, name, "F32", joints, 6, sizeof *to);
    for (int k = 0; k < joints; k++) to[6 * k] = to[6 * k + 3] = 1.0F;
}

/* The bytes of a model's file, and their number. */
static inline char *random_model(uint64_t seed, size_t *bytes) {
    model_writer w = {.random = {seed}, .header = malloc(HEADER_ROOM), .data = calloc(1, DATA_ROOM)};
    double offset[BS_POINTS][3];
    w.header_size = (size_t)sprintf(w.header, "{\"__metadata__\":{\"format\":\"bodysense-completion-2\"}");
    random_recurrent(&w, "body", 0, FEATURES_ACCELERATION, TINY_HIDDEN);
    random_recurrent(&w, "body", 1, TINY_HIDDEN, TINY_HIDDEN);
    random_recurrent(&w, "fingers", 0, HAND_FEATURES, TINY_HAND);
    random_branch(&w, "body.turn_branch", TINY_HIDDEN + FEATURES_ACCELERATION, TURNED);
    random_branch(&w, "body.judge_branch", TINY_HIDDEN + FEATURES_ACCELERATION, JUDGED);
    random_branch(&w, "fingers.branch", TINY_HAND + HAND_FEATURES, HAND_OUTPUTS);
    random_floats(&w, "body.usual_bones", BODY_POINTS, 3, 0.2);
    upright_axes(&w, "body.standing", BODY_JOINTS);
    random_floats(&w, "fingers.usual_bones", HAND_POINTS, 3, 0.5);
    upright_axes(&w, "fingers.relaxed", HAND_JOINTS);
    average_body(offset);
    memcpy(tensor_of(&w, "shape.mean", "F64", BS_POINTS, 3, sizeof(double)), offset, sizeof offset);
    double *component = tensor_of(&w, "shape.components", "F64", SHAPE_SIZE, 3 * BS_POINTS, sizeof *component);
    for (int k = 0; k < SHAPE_SIZE * 3 * BS_POINTS; k++) /* each makes some bones longer */
        component[k] = offset[k % (3 * BS_POINTS) / 3][k % 3] * between(&w.random, 0.0, 0.04);
    random_floats(&w, "errors.inward.weight", ERROR_HIDDEN, ERROR_KNOWN, 0.02);
    random_floats(&w, "errors.inward.bias", ERROR_HIDDEN, 1, 0.02);
    random_floats(&w, "errors.weight", 2 * BODY_POINTS, ERROR_KNOWN + ERROR_HIDDEN, 0.02);
    random_floats(&w, "errors.bias", 2 * BODY_POINTS, 1, 0.02);
    random_update(&w, "input_l0", FEATURES_ACCELERATION, 3 * TINY_HIDDEN);
    random_update(&w, "state_l0", TINY_HIDDEN, 3 * TINY_HIDDEN);
    random_update(&w, "input_l1", TINY_HIDDEN, 3 * TINY_HIDDEN);
    random_update(&w, "state_l1", TINY_HIDDEN, 3 * TINY_HIDDEN);
    random_update(&w, "turn_branch", TINY_HIDDEN + FEATURES_ACCELERATION, TINY_BRANCH);
    w.header[w.header_size++] = '}';
    while (w.header_size % 8) w.header[w.header_size++] = ' ';

    const uint64_t header_size = w.header_size;
    *bytes = sizeof header_size + w.header_size + w.data_size;
    char *file = malloc(*bytes);
    memcpy(file, &header_size, sizeof header_size);
    memcpy(file + sizeof header_size, w.header, w.header_size);
    memcpy(file + sizeof header_size + w.header_size, w.data, w.data_size);
    free(w.header);
    free(w.data);
    return file;
}

#endif
