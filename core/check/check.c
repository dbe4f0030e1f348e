/* Frames of arbitrary numbers through the whole interface, for sanitizers; also a libFuzzer target (-DFUZZ).
 *
 *     check [completion.safetensors [runs]]    a tiny random model if the file is omitted
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../test/random_model.h"

#define MOST_FRAMES 4
#define ALIGNED(bytes) (((bytes) + 63) / 64 * 64)

static const bs_model *model;

static void *memory(size_t bytes) {
    void *found = aligned_alloc(64, ALIGNED(bytes));
    if (!found) abort();
    return found;
}

/* The bytes of a file; NULL if it cannot be read. */
static char *read_file(const char *path, size_t *bytes) {
    FILE *file = fopen(path, "rb");
    if (!file) return NULL;
    fseek(file, 0, SEEK_END);
    *bytes = (size_t)ftell(file);
    rewind(file);
    char *content = malloc(*bytes);
    if (fread(content, 1, *bytes, file) != *bytes) abort();
    fclose(file);
    return content;
}

/* Open a file of weights, or a tiny random model if `path` is NULL. */
static int open_model(const char *path) {
    size_t bytes = 0;
    char *weights = path ? read_file(path, &bytes) : random_model(1, &bytes);
    if (!weights) return 0;
    for (size_t part = 0; part < bytes; part += bytes / 7 + 1) { /* truncated files are refused */
        char *copy = malloc(part ? part : 1); /* so that reading beyond is seen */
        memcpy(copy, weights, part);
        size_t size = bs_model_size(copy, part);
        if (size) {
            void *place = memory(size);
            const bs_model *refused;
            if (bs_model_open(copy, part, place, size, &refused) == BS_OK) abort();
            free(place);
        }
        free(copy);
    }
    size_t size = bs_model_size(weights, bytes);
    bs_result result = size ? bs_model_open(weights, bytes, memory(size), size, &model) : BS_MODEL_DAMAGED;
    if (result != BS_OK) fprintf(stderr, "%s: %s\n", path ? path : "the tiny model", bs_message(result));
    free(weights);
    return result == BS_OK;
}

/* Numbers from bytes: mostly plausible, else anything. */
typedef struct source {
    const unsigned char *data;
    size_t left;
} source;

static unsigned byte_of(source *from) {
    if (!from->left) return 0;
    --from->left;
    return *from->data++;
}

static double number_of(source *from, double scale) {
    unsigned kind = byte_of(from);
    double value;
    unsigned char raw[8];
    if (kind < 240) return scale * ((double)kind + (double)byte_of(from) / 256.0 - 120.0) / 120.0;
    if (kind == 240) return NAN;
    if (kind == 241) return INFINITY;
    if (kind == 242) return -1e30;
    if (kind == 243) return 1e-300;
    if (kind == 244) return 999.999;
    for (int k = 0; k < 8; ++k) raw[k] = (unsigned char)byte_of(from);
    memcpy(&value, raw, sizeof value);
    return value;
}

static void normalise(double q[4]) {
    double size = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int c = 0; c < 4 && size > 1e-9 && size < 1e9; ++c) q[c] /= size;
}

/* One run of frames of two people; all that is output must be finite. */
static void run(source *from) {
    static double position[2][MOST_FRAMES][BS_POINTS][3], rotation[2][MOST_FRAMES][BS_POINTS][4];
    static double accuracy[2][MOST_FRAMES][BS_POINTS], time[2][MOST_FRAMES];
    static uint8_t has_position[2][MOST_FRAMES][BS_POINTS], has_rotation[2][MOST_FRAMES][BS_POINTS];
    static double root[MOST_FRAMES][3], local[MOST_FRAMES][BS_JOINTS][4], points[MOST_FRAMES][BS_POINTS][3];
    static double confidence[MOST_FRAMES][BS_POINTS], bound[MOST_FRAMES][BS_POINTS], contact[MOST_FRAMES][BS_CONTACTS];
    static uint8_t measured[MOST_FRAMES][BS_POINTS];
    static int32_t point[BS_POINTS];
    bs_state *state[2];
    void *place[2];
    double now = 0;
    for (int p = 0; p < BS_POINTS; ++p) point[p] = p;
    for (int k = 0; k < 2; ++k) {
        bs_person person = {.height = byte_of(from) & 1 ? number_of(from, 0.6) + 1.6 : NAN, .height_deviation = 0.01};
        person.lengths = (int32_t)(byte_of(from) % 3);
        for (int m = 0; m < person.lengths; ++m)
            person.length[m] = (bs_length){(int32_t)byte_of(from) - 8, (int32_t)byte_of(from), number_of(from, 1), 0.01};
        if (bs_person_likeliest(model, &person) != BS_OK) {
            person = (bs_person){.height = NAN};
            if (bs_person_likeliest(model, &person) != BS_OK) abort();
        }
        for (int j = 0; j < BS_JOINTS; ++j) {
            bs_mount *mount = &person.mount[j];
            mount->worn = byte_of(from) % 8 == 1;
            mount->rotation_only = byte_of(from) % 4 == 1;
            for (int c = 0; c < 3; ++c) mount->translation[c] = number_of(from, 0.1);
            for (int c = 0; c < 4; ++c) mount->rotation[c] = number_of(from, 1);
            normalise(mount->rotation);
        }
        size_t size = bs_state_size(model);
        place[k] = memory(size);
        if (bs_state_start(model, &person, place[k], size, &state[k]) != BS_OK) { /* mounts, or a body too small */
            person = (bs_person){.height = NAN};
            if (bs_person_likeliest(model, &person) != BS_OK) abort();
            if (bs_state_start(model, &person, place[k], size, &state[k]) != BS_OK) abort();
        }
    }
    while (from->left) {
        bs_settings settings = bs_default_settings();
        bs_observation observation[2];
        bs_estimate estimate[2];
        int refused, frames = 1 + (int)(byte_of(from) % MOST_FRAMES);
        unsigned some = byte_of(from);
        settings.floor = some & 1 ? number_of(from, 1) : 0;
        settings.ease = some & 2 ? number_of(from, 0.2) : 0.25;
        settings.hold_feet = some & 4 ? 0 : 1;
        for (int k = 0; k < 2; ++k) {
            observation[k] = (bs_observation){frames, BS_POINTS, point, time[k], position[k][0][0], rotation[k][0][0],
                                              has_position[k][0], has_rotation[k][0], accuracy[k][0], NULL};
            estimate[k] = (bs_estimate){root[0], local[0][0], points[0][0], measured[0], confidence[0], bound[0],
                                        contact[0], NULL};
            for (int t = 0; t < frames; ++t) {
                unsigned step = byte_of(from);
                now += step < 250 ? 0.001 * step : number_of(from, 2);
                time[k][t] = now;
                for (int p = 0; p < BS_POINTS; ++p) {
                    unsigned kind = byte_of(from);
                    has_position[k][t][p] = kind % 3 == 0;
                    has_rotation[k][t][p] = kind % 5 == 0;
                    accuracy[k][t][p] = kind < 250 ? 0.001 * (1 + kind) : number_of(from, 1);
                    for (int c = 0; c < 3 && has_position[k][t][p]; ++c)
                        position[k][t][p][c] = number_of(from, 2) + (c == 1);
                    for (int c = 0; c < 4 && has_rotation[k][t][p]; ++c) rotation[k][t][p][c] = number_of(from, 1);
                    normalise(rotation[k][t][p]);
                }
            }
        }
        size_t size = bs_scratch_size(model, 2);
        void *scratch = memory(size);
        bs_result result = bs_step(model, &settings, 2, observation, state, estimate, scratch, size, &refused);
        free(scratch);
        if (result != BS_OK) {
            now = fmax(fmax(bs_state_time(state[0]), bs_state_time(state[1])), 0);
            if (!isfinite(now)) now = 0;
            continue;
        }
        for (int t = 0; t < frames; ++t)
            for (int p = 0; p < BS_POINTS; ++p) {
                double sum = points[t][p][0] + points[t][p][1] + points[t][p][2] + confidence[t][p] + bound[t][p];
                for (int c = 0; c < 4 && p < BS_JOINTS; ++c) sum += local[t][p][c];
                if (!isfinite(sum) || confidence[t][p] < 0) {
                    fprintf(stderr, "frame %d, point %s: not finite\n", t, bs_point_name(p));
                    abort();
                }
            }
    }
    for (int k = 0; k < 2; ++k) free(place[k]);
}

#ifdef FUZZ
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (!model && !open_model(NULL)) abort();
    run(&(source){data, size});
    return 0;
}
#else
int main(int count, char **arguments) {
    unsigned long long seed = 1;
    static unsigned char data[1 << 16];
    if (!open_model(count > 1 ? arguments[1] : NULL)) {
        fprintf(stderr, "usage: check [completion.safetensors [runs]]\n");
        return 2;
    }
    int runs = count > 2 ? atoi(arguments[2]) : 50;
    for (int n = 0; n < runs; ++n) {
        for (size_t k = 0; k < sizeof data; ++k) {
            seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
            data[k] = (unsigned char)(seed >> 56);
            if (data[k] >= 240 && n % 4) data[k] = 100; /* mostly frames that are accepted */
        }
        run(&(source){data, sizeof data});
    }
    printf("%d runs, kernel %s\n", runs, bs_model_kernel(model));
    return 0;
}
#endif
