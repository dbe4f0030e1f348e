/* Print the completed poses of a recording: a line a frame, with its time, the root's position, 52 rotations wxyz.
 *
 *     poses completion.safetensors recording.jsonl [height in metres]
 *
 * `bodysense simulate take.bvh --device three_point -o recording.jsonl` writes a recording.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bodysense.h"

/* Memory of the caller's, aligned as the library asks for; sizes of a program would come from bs_model_size and others. */
static _Alignas(64) char file[1 << 23], opened[1 << 24], memory[1 << 18], scratch[1 << 18];

static void check(bs_result result) {
    if (result == BS_OK) return;
    fprintf(stderr, "%s\n", bs_message(result));
    exit(1);
}

/* Read the numbers of "name": [1, 2, 3] in the object that follows "member"; 0 if it has none. */
static uint8_t numbers(const char *line, const char *member, const char *name, double *out, int count) {
    char quoted[64];
    const char *object = strstr(line, member), *end = object ? strchr(object, '}') : NULL;
    snprintf(quoted, sizeof quoted, "\"%s\"", name);
    char *at = object ? strstr(object, quoted) : NULL;
    if (!at || at > end) return 0;
    at = strchr(at, '[');
    for (int k = 0; at && k < count; k++) out[k] = strtod(at + 1, &at);
    return at != NULL;
}

int main(int count, char **arguments) {
    if (count < 3) return fprintf(stderr, "usage: poses completion.safetensors recording.jsonl [height in metres]\n"), 2;
    FILE *weights = fopen(arguments[1], "rb"), *recording = fopen(arguments[2], "r");
    if (!weights || !recording) return fprintf(stderr, "%s cannot be read\n", arguments[weights ? 2 : 1]), 2;
    const bs_model *model;
    check(bs_model_open(file, fread(file, 1, sizeof file, weights), opened, sizeof opened, &model));

    static bs_person person = {.height_deviation = 0.025};
    person.height = count > 3 ? atof(arguments[3]) : NAN;
    check(bs_person_likeliest(model, &person));
    bs_state *state;
    check(bs_state_start(model, &person, memory, sizeof memory, &state));

    static char line[1 << 16];
    static double position[BS_POINTS][3], turned[BS_POINTS][4], accuracy[BS_POINTS], time, root[3], local[BS_JOINTS][4];
    static uint8_t has_position[BS_POINTS], has_rotation[BS_POINTS];
    static int32_t point[BS_POINTS];
    for (int p = 0; p < BS_POINTS; p++) point[p] = p, accuracy[p] = 0.001;
    const bs_settings settings = bs_default_settings();
    const bs_observation observation = {1, BS_POINTS, point, &time, position[0], turned[0], has_position, has_rotation,
                                        accuracy, NULL};
    const bs_estimate estimate = {.root_position = root, .rotation = local[0]};
    while (fgets(line, sizeof line, recording)) {
        const char *at = strstr(line, "\"time\":");
        if (!at) continue; /* the header */
        time = atof(at + 7);
        for (int p = 0; p < BS_POINTS; p++) {
            has_position[p] = numbers(line, "\"position\"", bs_point_name(p), position[p], 3);
            has_rotation[p] = p < BS_JOINTS && numbers(line, "\"rotation\"", bs_point_name(p), turned[p], 4);
        }
        check(bs_step(model, &settings, 1, &observation, &state, &estimate, scratch, sizeof scratch, NULL));
        printf("%.6f %.6f %.6f %.6f", time, root[0], root[1], root[2]);
        for (int k = 0; k < 4 * BS_JOINTS; k++) printf(" %.6f", local[k / 4][k % 4]);
        printf("\n");
    }
    return 0;
}
