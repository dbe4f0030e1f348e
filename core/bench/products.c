/* Time the matrix products of one step alone, which is the least that a step can take.
 *
 *     products completion.safetensors rounds people …
 *
 * Prints a line for each number of people: median milliseconds for one of them, by the fastest kernel.
 */
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "../src/network/layers.h"

#define WARM_UP 20

static double milliseconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e3 * (double)now.tv_sec + 1e-6 * (double)now.tv_nsec;
}

static int by_size(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void *memory_of(size_t bytes) {
    char *start = calloc(bytes + 64, 1);
    if (!start) exit(1);
    return start + (64 - (size_t)start % 64);
}

/* Vectors of random numbers. */
static inputs random_inputs(const bs_model *m, int columns, int size, int steps) {
    scratch counted = {NULL, 0};
    inputs_of(m, &counted, columns, size, steps);
    scratch room = {memory_of(counted.used), 0};
    const inputs x = inputs_of(m, &room, columns, size, steps);
    float *values = memory_of((size_t)columns * (size_t)size * sizeof *values);
    for (int k = 0; k < columns * size; k++) values[k] = (float)rand() / (float)RAND_MAX - 0.5F;
    quantise_columns(m, columns, values, size, x);
    return x;
}

/* The products of a step of `people` people, each with their mirror image. */
static void products(const bs_model *m, int people, const inputs *of, float *out) {
    const inputs features = of[0], hidden = of[1], hand_features = of[2], hand_hidden = of[3];
    const struct {
        const matrix *table;
        inputs x;
    } every[] = {
        {&m->turn.of_hidden, hidden},         {&m->turn.of_features, features},
        {&m->judge.of_hidden, hidden},        {&m->judge.of_features, features},
        {&m->hands.of_input, hand_features},  {&m->hands.of_state, hand_hidden},
        {&m->fingers.of_hidden, hand_hidden}, {&m->fingers.of_features, hand_features},
    };
    for (int layer = 0; layer < m->layers; layer++) {
        const matrix *given = &m->layer[layer].of_input, *kept = &m->layer[layer].of_state;
        const inputs x = layer ? hidden : features;
        multiply_columns(m, given, 2 * people, x, out, (size_t)grouped(given->rows));
        multiply_columns(m, kept, 2 * people, hidden, out, (size_t)grouped(kept->rows));
    }
    for (size_t k = 0; k < sizeof every / sizeof *every; k++)
        multiply_columns(m, every[k].table, 2 * people, every[k].x, out, (size_t)grouped(every[k].table->rows));
}

int main(int count, char **arguments) {
    FILE *file = count > 3 ? fopen(arguments[1], "rb") : NULL;
    if (!file) return fprintf(stderr, "usage: products completion.safetensors rounds people …\n"), 2;
    char *bytes = memory_of(1 << 24);
    const size_t size = fread(bytes, 1, 1 << 24, file), needed = bs_model_size(bytes, size);
    const bs_model *m;
    const bs_result result = bs_model_open(bytes, size, memory_of(needed), needed, &m);
    if (result != BS_OK) return fprintf(stderr, "%s\n", bs_message(result)), 1;
    const int rounds = atoi(arguments[2]);
    double *taken = memory_of((size_t)rounds * sizeof *taken);
    for (int place = 3; place < count; place++) {
        const int people = atoi(arguments[place]), columns = 2 * people;
        const inputs of[] = {random_inputs(m, columns, m->features, FEATURE_STEPS), random_inputs(m, columns, m->hidden, STATE_STEPS),
                             random_inputs(m, columns, HAND_FEATURES, FEATURE_STEPS),
                             random_inputs(m, columns, m->hand_hidden, STATE_STEPS)};
        float *out = memory_of((size_t)columns * (size_t)grouped(3 * m->hidden) * sizeof(float));
        for (int round = -WARM_UP; round < rounds; round++) {
            const double start = milliseconds();
            products(m, people, of, out);
            if (round >= 0) taken[round] = (milliseconds() - start) / people;
        }
        qsort(taken, (size_t)rounds, sizeof *taken, by_size);
        printf("%.6f\n", taken[rounds / 2]);
    }
    return 0;
}
