#include "person.h"

#include <string.h>

#include "../base/maths.h"
#include "../constants.h"
#include "shape.h"

#define FLOOR (-1)     /* in place of a length's end: its height over the floor */
#define HEAD_OVER_FLOOR (EVIDENCE - 1)

#define SHRINKING (-1) /* in place of the stature that a body may not fall far below: it may */

/* A length that depends on proportions: the quantile that is used, and its difference from the rest pose. */
static const struct evidence {
    signed char start, end;
    float quantile, deviation, slack; /* m */
} LENGTH[EVIDENCE] = {
    {LEFT_SHOULDER, LEFT_ELBOW, LENGTH_SURE, NOISE_BONE, 0},
    {RIGHT_SHOULDER, RIGHT_ELBOW, LENGTH_SURE, NOISE_BONE, 0},
    {LEFT_ELBOW, LEFT_WRIST, LENGTH_SURE, NOISE_BONE, 0},
    {RIGHT_ELBOW, RIGHT_WRIST, LENGTH_SURE, NOISE_BONE, 0},
    {LEFT_HIP, LEFT_KNEE, LENGTH_SURE, NOISE_BONE, 0},
    {RIGHT_HIP, RIGHT_KNEE, LENGTH_SURE, NOISE_BONE, 0},
    {LEFT_KNEE, LEFT_ANKLE, LENGTH_SURE, NOISE_BONE, 0},
    {RIGHT_KNEE, RIGHT_ANKLE, LENGTH_SURE, NOISE_BONE, 0},
    {LEFT_ANKLE, LEFT_FOOT, LENGTH_SURE, NOISE_BONE, 0},
    {RIGHT_ANKLE, RIGHT_FOOT, LENGTH_SURE, NOISE_BONE, 0},
    {LEFT_WRIST, LEFT_MIDDLE1, LENGTH_SURE, NOISE_HAND, 0},
    {RIGHT_WRIST, RIGHT_MIDDLE1, LENGTH_SURE, NOISE_HAND, 0},
    {LEFT_HIP, LEFT_ANKLE, LENGTH_LEG, NOISE_LEG, SLACK_LEG},
    {RIGHT_HIP, RIGHT_ANKLE, LENGTH_LEG, NOISE_LEG, SLACK_LEG},
    {LEFT_SHOULDER, LEFT_WRIST, LENGTH_ARM, NOISE_ARM, SLACK_ARM},
    {RIGHT_SHOULDER, RIGHT_WRIST, LENGTH_ARM, NOISE_ARM, SLACK_ARM},
    {LEFT_SHOULDER, RIGHT_SHOULDER, LENGTH_SURE, NOISE_SHOULDERS, 0},
    {LEFT_HIP, RIGHT_HIP, LENGTH_SURE, NOISE_BONE, 0},
    {PELVIS, HEAD, LENGTH_LEG, NOISE_LEG, SLACK_LEG},
    {HEAD, FLOOR, LENGTH_LEG, NOISE_ARM, SLACK_LEG},
};

bs_result check_person(const bs_person *person) {
    double low = INFINITY, high = -INFINITY, height[BS_POINTS];
    for (int p = 0; p < BS_POINTS; ++p) {
        for (int c = 0; c < 3; ++c)
            if (!(fabs(person->rest_offset[p][c]) < PERSON_TALLEST)) return BS_PERSON_IMPOSSIBLE;
        if (!(person->deviation[p] >= 0 && isfinite(person->deviation[p]))) return BS_PERSON_IMPOSSIBLE;
        height[p] = p == PELVIS ? 0.0 : height[PARENT[p]] + person->rest_offset[p][1];
        low = fmin(low, height[p]);
        high = fmax(high, height[p]);
    }
    if (!(high - low >= PERSON_SHORTEST - SKELETON_SOLE && high - low <= PERSON_TALLEST)) return BS_PERSON_IMPOSSIBLE;
    if (!isnan(person->height)) {
        if (!(person->height >= PERSON_SHORTEST && person->height <= PERSON_TALLEST)) return BS_PERSON_IMPOSSIBLE;
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
            if (!(fabs(mount->translation[c]) < PERSON_TALLEST)) return BS_PERSON_IMPOSSIBLE;
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

/* Whether nothing is known of the body, not even by an earlier session. */
static bool is_unknown(const bs_person *person) {
    double leg = 0.0;
    for (int p = LEFT_ANKLE; p != PELVIS; p = PARENT[p]) leg += person->deviation[p];
    return isnan(person->height) && person->lengths == 0 && leg > UNKNOWN_LEG;
}

void proportions_start(const bs_person *person, proportions *own) {
    memset(own, 0, sizeof *own);
    memcpy(own->current, person->rest_offset, sizeof own->current);
    memcpy(own->believed, person->rest_offset, sizeof own->believed);
    memcpy(own->deviation, person->deviation, sizeof own->deviation);
    own->head[0] = NAN;
}

/* Count a frame's lengths, `passed` s after the frame that was looked at before. Returns whether there are any. */
static bool count(const tracked *seen, double passed, proportions *own) {
    bool any = false;
    for (int k = 0; k < EVIDENCE; ++k) {
        int start = LENGTH[k].start, end = LENGTH[k].end == FLOOR ? start : LENGTH[k].end;
        if (!seen->has_position[start] || !seen->has_position[end]) continue;
        if (!(seen->accuracy[start] + seen->accuracy[end] < LENGTH_VAGUE)) continue;
        double value = LENGTH[k].end == FLOOR ? seen->position[start].y - seen->floor
                                              : distance(seen->position[start], seen->position[end]);
        if (!(value > 0 && value < LENGTH_BIN * BINS)) continue;
        own->seconds[k][(int)(value / LENGTH_BIN)] += (float)fmin(passed, 2 * LENGTH_INTERVAL);
        any = true;
    }
    return any;
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
    return (bin + 0.5) * LENGTH_BIN;
}

/* How high the head's joint is when the body is as upright as it has been: the middle of what is within a walker's bob
 * of the top. Not a high quantile, which would be the top of the bob, and after hours in a chair would still be there. */
static double upright_head(const float seconds[BINS], double *total) {
    double above = 0.0, sum = 0.0;
    int top = BINS - 1;
    *total = 0.0;
    for (int b = 0; b < BINS; ++b) *total += seconds[b];
    double enough = fmin(UPRIGHT_SECONDS, *total / 2);
    for (; top > 0; --top)
        if ((above += seconds[top]) >= enough && above > 0) break;
    int low = top - (int)(WALKING_BOB / LENGTH_BIN) < 0 ? 0 : top - (int)(WALKING_BOB / LENGTH_BIN);
    for (int b = low; b < top; ++b) above += seconds[b];
    int bin = low;
    for (; bin < BINS - 1; ++bin)
        if ((sum += seconds[bin]) >= above / 2) break;
    return (bin + 0.5) * LENGTH_BIN;
}

enum stance { STANDS, SITS, LOW, HIGH };

static double log_normal(double value, double variance) { return -0.5 * (value * value / variance + logarithm_double(variance)); }

/* Whether the wearer stands or sits, and what the head's height then says of the stature: NaN if nothing.
 *
 * `believed` is the body that all else suggests. A head may be a small body's that stands, a large body's that sits, or
 * be lower (kneeling, crouching) or higher (on stairs) than either; the likeliest of these is taken. */
static enum stance infer_height(proportions *own, double head, double total, double *height, double *deviation) {
    double stature = rest_height(own->believed, HEAD_TOP), ratio = stature / rest_height(own->believed, HEAD);
    double unsure = STATURE_DEVIATION * STATURE_DEVIATION, walks = own->walked / WALK_SECONDS,
           standing = head + STANDING_STOOP;
    double best = log_normal(standing - stature / ratio, STANDING_NOISE * STANDING_NOISE + unsure / (ratio * ratio));
    double sits = log_normal(head - SEATED_HEAD - SEATED_SLOPE * (stature - STATURE_MEAN),
                             SEATED_NOISE * SEATED_NOISE + SEATED_SLOPE * SEATED_SLOPE * unsure) - walks;
    enum stance found = STANDS;
    *height = standing * ratio;
    *deviation = STANDING_NOISE * (1 + 1 / (1 + total)) * ratio;
    if (sits > best) {
        found = SITS;
        best = sits;
        *height = STATURE_MEAN + (head - SEATED_HEAD) / SEATED_SLOPE;
        *deviation = SEATED_NOISE / SEATED_SLOPE;
    }
    if ((head < LOW_HEAD && LOW_LIKELIHOOD - walks > best) || head > HIGH_HEAD) {
        found = head > HIGH_HEAD ? HIGH : LOW;
        *height = NAN;
    }
    return found;
}

/* Add a length; one of the right side is averaged with the left one's, for bodies are symmetric. */
static void add_length(measurements *known, bs_length length) {
    bs_length *last = known->lengths > 0 ? &known->length[known->lengths - 1] : NULL;
    bool right = PARTNER[length.start] < length.start;
    if (right) length = (bs_length){PARTNER[length.start], PARTNER[length.end], length.value, length.deviation};
    if (right && last && last->start == length.start && last->end == length.end) {
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

/* Whether the height is known, and the head has not contradicted it. */
static bool knows_height(const bs_person *person, const proportions *own) {
    return !isnan(person->height) && !own->released;
}

/* The likeliest body for lengths that were seen or are known, and a height that was inferred or else stated. */
static void fit_lengths(const bs_model *model, const bs_person *person, double height, double height_deviation,
                        bool is_stated, proportions *own) {
    measurements known = {height, height_deviation, is_stated, .lengths = 0};
    for (int k = 0; k < HEAD_OVER_FLOOR; ++k) {
        const struct evidence *row = &LENGTH[k];
        double total, value = quantile(own->seconds[k], row->quantile, &total) + row->slack;
        if (total > 0)
            add_length(&known, (bs_length){row->start, row->end, value, row->deviation * (1 + 2 / (1 + total))});
    }
    for (int m = 0; m < person->lengths; ++m) replace_length(&known, person->length[m]);
    likeliest_body(model, &known, own->believed, own->deviation);
}

/* Choose the most likely body given the known parts and the evidence. */
static void fit_body(const bs_model *model, const bs_person *person, proportions *own) {
    double total, head = upright_head(own->seconds[HEAD_OVER_FLOOR], &total), height, deviation;
    if (knows_height(person, own)) {
        fit_lengths(model, person, person->height, person->height_deviation, true, own);
        return;
    }
    fit_lengths(model, person, NAN, NAN, false, own); /* what is expected of the head's height */
    if (total > 0) {
        enum stance found = infer_height(own, head, total, &height, &deviation);
        if (isfinite(height)) fit_lengths(model, person, height, deviation, false, own);
        /* A body that was guessed from a seat gives way to one that walks, if they differ by much. */
        bool mistaken = found == STANDS && own->seated &&
                        rest_height(own->believed, HEAD_TOP) < own->tallest - SEAT_MISTAKEN;
        if (mistaken && own->walked > 0) {
            own->tallest = SHRINKING;
            own->seated = 0;
        }
        if (found != STANDS) own->seated = 1;
    }
    double stature = rest_height(own->believed, HEAD_TOP), least = own->tallest - SHRINK_MOST;
    if (stature < least)
        for (int p = 0; p < BS_POINTS; ++p)
            for (int c = 0; c < 3; ++c) own->believed[p][c] *= least / stature;
}

/* Look at how the head moves: whether it walks, and whether it is too high for the height that is known. */
static void look_at_head(const bs_person *person, const tracked *seen, proportions *own) {
    vec3 at = seen->position[HEAD];
    double share = fmin(own->since / WALK_LAG, 1.0);
    double world[3] = {seen->base[0] + (double)at.x, seen->base[1] + (double)at.y, seen->base[2] + (double)at.z};
    double velocity[3], total, height = (double)(at.y - seen->floor);
    if (!seen->has_position[HEAD]) return;
    for (int c = 0; c < 3; ++c) velocity[c] = (world[c] - own->head[c]) / own->since;
    own->speed = sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2]);
    bool first = !isfinite(own->speed);
    for (int c = 0; c < 3; ++c) {
        own->been[c] = first ? world[c] : own->been[c] + share * (world[c] - own->been[c]);
        own->head[c] = world[c];
    }
    if (first) own->speed = 0.0;
    double aside = own->head[0] - own->been[0], forward = own->head[2] - own->been[2];
    double ahead = sqrt(aside * aside + forward * forward);
    if (ahead > WALK_AHEAD && ahead < WALK_FARTHEST &&
        height > upright_head(own->seconds[HEAD_OVER_FLOOR], &total) - WALKING_BOB)
        own->walked += own->since;
    bool above = !isnan(person->height) && height > rest_height(own->believed, HEAD) + HEIGHT_TIPTOE;
    own->contradicting = above ? own->contradicting + own->since : 0.0;
    if (own->contradicting > HEIGHT_CONTRADICTED) own->released = 1;
}

/* Move the body in use toward the believed one: slowly, so that a still wearer does not visibly grow, or quickly to a
 * known height. */
static void approach(const bs_person *person, double interval, proportions *own) {
    double now = rest_height(own->current, HEAD_TOP), goal = rest_height(own->believed, HEAD_TOP);
    double most = interval * (own->speed > GROWTH_MOVES || knows_height(person, own) ? GROWTH_MOVING : GROWTH_STILL);
    double share = 1.0 - exponential_double(-LN_2 * interval / BODY_HALF_LIFE);
    if (share * fabs(goal - now) > most) share = most / fabs(goal - now);
    for (int p = 0; p < BS_POINTS; ++p)
        for (int c = 0; c < 3; ++c) own->current[p][c] += share * (own->believed[p][c] - own->current[p][c]);
}

void proportions_step(const bs_model *model, const bs_person *person, const tracked *seen, double interval,
                      proportions *own) {
    if (is_known(person)) return;
    own->since += interval;
    own->due += interval;
    if (own->since >= LENGTH_INTERVAL || own->elapsed <= 0) {
        bool first = count(seen, own->since, own) && own->elapsed <= 0;
        look_at_head(person, seen, own);
        if (first || own->elapsed > 0) own->elapsed += own->since;
        own->since = 0.0;
        if (first || own->due >= BODY_INTERVAL) {
            fit_body(model, person, own);
            own->due = 0.0;
        }
        /* An unknown body starts as the first frame suggests, because it was not output yet. */
        if (first && is_unknown(person)) memcpy(own->current, own->believed, sizeof own->current);
    }
    approach(person, interval, own);
    double stature = rest_height(own->current, HEAD_TOP);
    bool arrived = stature < rest_height(own->believed, HEAD_TOP) + SHRINK_MOST;
    if (own->elapsed >= SHRINK_SECONDS && (own->tallest >= 0 || arrived)) own->tallest = fmax(own->tallest, stature);
}

void proportions_update(const bs_model *model, const bs_person *before, const bs_person *person, proportions *own) {
    if (isnan(before->height) != isnan(person->height) || fabs(before->height - person->height) > 0) {
        own->released = 0;
        own->contradicting = own->tallest = 0.0;
    }
    if (is_known(person)) {
        memcpy(own->current, person->rest_offset, sizeof own->current);
        memcpy(own->believed, person->rest_offset, sizeof own->believed);
        memcpy(own->deviation, person->deviation, sizeof own->deviation);
    } else {
        fit_body(model, person, own);
    }
}
