#include "person.h"

#include <string.h>

#include "shape.h"

#define BIN 0.005      /* m */
#define SEATED 1.28    /* m: heads that never rise higher sit, for the shortest adult's stands higher */
#define STANDING 1.95  /* m: nobody's head joint stands higher */
#define LOOK 0.1       /* s between two looks at lengths */
#define ENOUGH 0.5     /* s that a length must have been seen */
#define FIT_EVERY 0.5  /* s between two fits */
#define QUICK 0.4      /* s in which half of what the body in use lacks is made up */
#define VAGUE 0.06     /* m: points that err more together measure nothing */
#define FLOOR (-1)     /* in place of a length's end: its height over the floor */
#define SHORTEST 1.0   /* m, of a person */
#define TALLEST 2.3
#define SOLE 0.05      /* m: a skeleton's lowest points are above the sole */

/* A length that tells of proportions: which quantile of it is taken, and how it then differs from the rest pose. */
static const struct evidence {
    signed char start, end;
    float quantile, deviation, slack; /* m */
} LENGTH[EVIDENCE] = {
    {LEFT_SHOULDER, LEFT_ELBOW, 0.5F, 0.006F, 0}, {RIGHT_SHOULDER, RIGHT_ELBOW, 0.5F, 0.006F, 0},
    {LEFT_ELBOW, LEFT_WRIST, 0.5F, 0.006F, 0}, {RIGHT_ELBOW, RIGHT_WRIST, 0.5F, 0.006F, 0},
    {LEFT_HIP, LEFT_KNEE, 0.5F, 0.006F, 0}, {RIGHT_HIP, RIGHT_KNEE, 0.5F, 0.006F, 0},
    {LEFT_KNEE, LEFT_ANKLE, 0.5F, 0.006F, 0}, {RIGHT_KNEE, RIGHT_ANKLE, 0.5F, 0.006F, 0},
    {LEFT_ANKLE, LEFT_FOOT, 0.5F, 0.006F, 0}, {RIGHT_ANKLE, RIGHT_FOOT, 0.5F, 0.006F, 0},
    {LEFT_WRIST, LEFT_MIDDLE1, 0.5F, 0.004F, 0}, {RIGHT_WRIST, RIGHT_MIDDLE1, 0.5F, 0.004F, 0},
    {LEFT_HIP, LEFT_ANKLE, 0.95F, 0.02F, 0.01F}, {RIGHT_HIP, RIGHT_ANKLE, 0.95F, 0.02F, 0.01F},
    {LEFT_SHOULDER, LEFT_WRIST, 0.98F, 0.03F, 0.02F}, {RIGHT_SHOULDER, RIGHT_WRIST, 0.98F, 0.03F, 0.02F},
    {LEFT_SHOULDER, RIGHT_SHOULDER, 0.5F, 0.01F, 0}, {LEFT_HIP, RIGHT_HIP, 0.5F, 0.006F, 0},
    {PELVIS, HEAD, 0.95F, 0.02F, 0.01F}, {HEAD, FLOOR, 0.95F, 0.03F, 0.01F},
};

bs_result check_person(const bs_person *person) {
    double low = INFINITY, high = -INFINITY, height[BS_POINTS];
    for (int p = 0; p < BS_POINTS; ++p) {
        for (int c = 0; c < 3; ++c)
            if (!(fabs(person->rest_offset[p][c]) < TALLEST)) return BS_PERSON_IMPOSSIBLE;
        if (!(person->deviation[p] >= 0 && isfinite(person->deviation[p]))) return BS_PERSON_IMPOSSIBLE;
        height[p] = p == PELVIS ? 0.0 : height[PARENT[p]] + person->rest_offset[p][1];
        low = fmin(low, height[p]);
        high = fmax(high, height[p]);
    }
    if (!(high - low >= SHORTEST - SOLE && high - low <= TALLEST)) return BS_PERSON_IMPOSSIBLE;
    if (!isnan(person->height)) {
        if (!(person->height >= SHORTEST && person->height <= TALLEST)) return BS_PERSON_IMPOSSIBLE;
        if (!(person->height_deviation > 0 && isfinite(person->height_deviation))) return BS_PERSON_IMPOSSIBLE;
    }
    if (person->lengths < 0 || person->lengths > BS_LENGTHS) return BS_PERSON_IMPOSSIBLE;
    for (int m = 0; m < person->lengths; ++m) {
        const bs_length *length = &person->length[m];
        if (length->start < 0 || length->start >= BS_POINTS || length->end < 0 || length->end >= BS_POINTS ||
            length->start == length->end)
            return BS_PERSON_IMPOSSIBLE;
        if (!(length->value > 0 && isfinite(length->value) && length->deviation > 0 && isfinite(length->deviation)))
            return BS_PERSON_IMPOSSIBLE;
    }
    for (int j = 0; j < BS_JOINTS; ++j) {
        const bs_mount *mount = &person->mount[j];
        double square = 0.0;
        if (!mount->worn) continue;
        for (int c = 0; c < 3; ++c)
            if (!isfinite(mount->translation[c])) return BS_PERSON_IMPOSSIBLE;
        for (int c = 0; c < 4; ++c) square += mount->rotation[c] * mount->rotation[c];
        if (!(fabs(square - 1.0) < 0.02)) return BS_PERSON_IMPOSSIBLE;
    }
    return BS_OK;
}

/* Whether all proportions are known exactly. */
static bool is_known(const bs_person *person) {
    for (int p = 0; p < BS_POINTS; ++p)
        if (person->deviation[p] != 0) return false;
    return true;
}

void proportions_start(const bs_person *person, proportions *own) {
    memset(own, 0, sizeof *own);
    memcpy(own->shown, person->rest_offset, sizeof own->shown);
    memcpy(own->believed, person->rest_offset, sizeof own->believed);
    memcpy(own->deviation, person->deviation, sizeof own->deviation);
}

/* Count a frame's lengths, `passed` s after the frame that was looked at before. */
static void count(const tracked *seen, double passed, proportions *own) {
    for (int k = 0; k < EVIDENCE; ++k) {
        int start = LENGTH[k].start, end = LENGTH[k].end == FLOOR ? start : LENGTH[k].end;
        if (!seen->has_position[start] || !seen->has_position[end]) continue;
        if (!(seen->accuracy[start] + seen->accuracy[end] < VAGUE)) continue;
        double value = LENGTH[k].end == FLOOR ? seen->position[start].y - seen->floor
                                              : distance(seen->position[start], seen->position[end]);
        if (value > 0 && value < BIN * BINS) own->seconds[k][(int)(value / BIN)] += (float)fmin(passed, 2 * LOOK);
    }
}

/* The quantile of a length, and for how many seconds it was seen. */
static double quantile(const float seconds[BINS], float share, double *total) {
    double sum = 0.0;
    int bin = 0;
    *total = 0.0;
    for (int b = 0; b < BINS; ++b) *total += seconds[b];
    for (; bin < BINS - 1; ++bin) {
        sum += seconds[bin];
        if (sum >= share * *total) break;
    }
    return (bin + 0.5) * BIN;
}

/* Stature over the height of the head's joint, of the mean adult. */
static double stature_ratio(const bs_model *model) {
    measurements nothing = {.height = NAN, .lengths = 0};
    double rest_offset[BS_POINTS][3], deviation[BS_POINTS];
    likeliest_body(model, &nothing, rest_offset, deviation);
    return rest_height(rest_offset, HEAD_TOP) / rest_height(rest_offset, HEAD);
}

/* Add a length; one of the right side is averaged with the left one's, for bodies are symmetric. */
static void add_length(measurements *known, bs_length length) {
    bs_length *last = &known->length[known->lengths - 1];
    bool right = PARTNER[length.start] < length.start;
    if (right) length = (bs_length){PARTNER[length.start], PARTNER[length.end], length.value, length.deviation};
    if (right && known->lengths > 0 && last->start == length.start && last->end == length.end) {
        last->value = (last->value + length.value) / 2;
        last->deviation = (last->deviation + length.deviation) / 2;
    } else {
        known->length[known->lengths++] = length;
    }
}

/* Add a length that is known, in place of the one that was seen. */
static void replace_length(measurements *known, bs_length length) {
    int place = 0;
    while (place < known->lengths && (known->length[place].start != length.start || known->length[place].end != length.end))
        ++place;
    known->length[place] = length;
    if (place == known->lengths) ++known->lengths;
}

/* Believe in the body that is likeliest given what is known and what was seen. */
static void fit_body(const bs_model *model, const bs_person *person, proportions *own) {
    measurements known = {.height = person->height, .height_deviation = person->height_deviation, .lengths = 0};
    for (int k = 0; k < EVIDENCE; ++k) {
        const struct evidence *row = &LENGTH[k];
        double total, value = quantile(own->seconds[k], row->quantile, &total) + row->slack;
        double deviation = row->deviation * (1.0 + 2.0 / (1.0 + total));
        if (!(total > ENOUGH)) continue;
        if (row->end != FLOOR) {
            add_length(&known, (bs_length){row->start, row->end, value, deviation});
        } else if (isnan(person->height) && SEATED < value && value < STANDING) {
            /* Heads that stand higher than any adult's are on stairs, or over a floor of another height. */
            double ratio = stature_ratio(model);
            known.height = value * ratio;
            known.height_deviation = deviation * ratio;
        }
    }
    for (int m = 0; m < person->lengths; ++m) replace_length(&known, person->length[m]);
    likeliest_body(model, &known, own->believed, own->deviation);
}

void proportions_step(const bs_model *model, const bs_person *person, const tracked *seen, double interval,
                      proportions *own) {
    if (is_known(person)) return;
    own->since += interval;
    own->due += interval;
    if (own->since >= LOOK) {
        count(seen, own->since, own);
        own->since = 0.0;
        if (own->due >= FIT_EVERY) {
            fit_body(model, person, own);
            own->due = 0.0;
        }
    }
    double share = 1.0 - exp2(-interval / QUICK);
    for (int p = 0; p < BS_POINTS; ++p)
        for (int c = 0; c < 3; ++c) own->shown[p][c] += share * (own->believed[p][c] - own->shown[p][c]);
}

void proportions_update(const bs_model *model, const bs_person *person, proportions *own) {
    if (is_known(person)) {
        memcpy(own->shown, person->rest_offset, sizeof own->shown);
        memcpy(own->believed, person->rest_offset, sizeof own->believed);
        memcpy(own->deviation, person->deviation, sizeof own->deviation);
    } else {
        fit_body(model, person, own);
    }
}
