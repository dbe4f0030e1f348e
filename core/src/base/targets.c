/* Inverse kinematics of any skeleton: see targets.h. Gauss-Newton steps, damped if they raise the cost.
 *
 * The unknowns of a step are the move of the root and one world turn φ for each joint. Joint c moves with its parent j by
 * m_c = m_j + φ_j × b, with b the bone between them. So the least cost of a joint's subtree is a quadratic form of its
 * move and turn. From the tips to the root the turn of each joint is eliminated; from the root to the tips it is solved. */
#include "targets.h"

#include <math.h>
#include <string.h>

#include "doubles.h"

#define ROUNDING 1e-9      /* share by which a cost may rise */
#define LEAST_COST 1e-12   /* m²; a rise that is less is rounding, and so are all weights */
#define SHORTEST_BONE 1e-3 /* m; guard against division by zero */

/* A posed body and its distances from targets and rest. */
typedef struct posed {
    double *root, *world, *local, *position; /* as in bs_reached */
    double *matrix;                          /* (joints, 3, 3) world ← joint */
    double *bone;                            /* (points, 3) m, world, from its parent to each point but the root */
    double *error;                           /* (points, 3) m, points minus targets */
    double *spring;                          /* (joints, 3) m, how far local rotations are from rest */
    double *away;                            /* (joints, 4) m, weighted rotations from the targets */
    double cost, total;                      /* m²: of the targets; with the springs */
} posed;

/* The least cost of a joint's subtree: a quadratic form of its move and turn. */
typedef struct form {
    double moves[9], both[9], turns[9], move[3], turn[3]; /* `both`: rows of the move, columns of the turn */
} form;

/* The turn of a joint by its own move, its parent's turn, and 1. */
typedef struct gain {
    double move[9], parent[9], one[3];
} gain;

enum { FORM = sizeof(form) / sizeof(double), GAIN = sizeof(gain) / sizeof(double) };
enum { OF_JOINT = 4 + 4 + 9 + 3 + 4, OF_POINT = 3 + 3 + 3 }; /* doubles of a posed body */

typedef struct workspace {
    form *forms;   /* (joints) */
    gain *gains;   /* (joints) */
    double *slope; /* (joints, 3, 3) transposed derivatives of the springs by the joint's own turn */
    double *moved; /* (joints, 6) moves and turns */
    double *force; /* (points, 3) */
} workspace;

size_t bs_reach_memory(const bs_tree *tree) {
    return 2 * 3 + (2 * OF_JOINT + FORM + GAIN + 9 + 6) * (size_t)tree->joints + (2 * OF_POINT + 3) * (size_t)tree->points;
}

static double *take(double **memory, size_t count) {
    double *taken = *memory;
    *memory += count;
    return taken;
}

static posed posed_in(const bs_tree *tree, double **memory) {
    const size_t joints = (size_t)tree->joints, points = (size_t)tree->points;
    posed p = {.cost = 0};
    p.root = take(memory, 3);
    p.world = take(memory, 4 * joints);
    p.local = take(memory, 4 * joints);
    p.position = take(memory, 3 * points);
    p.matrix = take(memory, 9 * joints);
    p.bone = take(memory, 3 * points);
    p.error = take(memory, 3 * points);
    p.spring = take(memory, 3 * joints);
    p.away = take(memory, 4 * joints);
    return p;
}

/* Solve a x = b for a symmetric positive definite matrix (n, n), by Cholesky; `b` (n, columns) becomes x. */
static inline void solve_positive(int n, double *a, int columns, double *b) {
    for (int k = 0; k < n; k++) {
        double pivot = a[n * k + k];
        for (int i = 0; i < k; i++) pivot -= a[n * k + i] * a[n * k + i];
        const double inverse = 1 / sqrt(pivot);
        a[n * k + k] = inverse;
        for (int row = k + 1; row < n; row++) {
            double value = a[n * row + k];
            for (int i = 0; i < k; i++) value -= a[n * row + i] * a[n * k + i];
            a[n * row + k] = value * inverse;
        }
    }
    for (int column = 0; column < columns; column++) {
        for (int k = 0; k < n; k++) {
            for (int i = 0; i < k; i++) b[columns * k + column] -= a[n * k + i] * b[columns * i + column];
            b[columns * k + column] *= a[n * k + k];
        }
        for (int k = n - 1; k >= 0; k--) {
            for (int i = k + 1; i < n; i++) b[columns * k + column] -= a[n * i + k] * b[columns * i + column];
            b[columns * k + column] *= a[n * k + k];
        }
    }
}

/* The matrix S with S φ = φ × bone. */
static inline void swing_of(const double bone[3], double swing[9]) {
    const double s[9] = {0, bone[2], -bone[1], -bone[2], 0, bone[0], bone[1], -bone[0], 0};
    memcpy(swing, s, sizeof s);
}

/* The transposed derivative of twice the vector part of a quaternion by a small turn in world axes, with the matrix from
 * the quaternion's own axes to the world. */
static inline void slope_of(const double matrix[9], const double q[4], const double scale[3], double slope[9]) {
    const double tangent[9] = {q[0] * scale[0],  q[3] * scale[1], -q[2] * scale[2], -q[3] * scale[0], q[0] * scale[1],
                               q[1] * scale[2], q[2] * scale[0], -q[1] * scale[1], q[0] * scale[2]};
    memset(slope, 0, 9 * sizeof *slope);
    add_product(matrix, tangent, 3, 1, slope);
}

/* Place the points of a body by its root and world rotations, and compute its distances. */
static void measure(const bs_posable *body, const bs_targets *targets, posed *p) {
    const bs_tree *tree = &body->tree;
    double springs = 0;
    p->cost = 0;
    for (int32_t joint = 0; joint < tree->joints; joint++) {
        const double *own = p->world + 4 * joint, *above = p->world + 4 * (joint ? tree->parent[joint] : 0);
        const double inverse[4] = {above[0], -above[1], -above[2], -above[3]};
        double *local = p->local + 4 * joint;
        matrix_of_quaternion(own, p->matrix + 9 * joint);
        if (joint) multiply_quaternions(inverse, own, local);
        else memcpy(local, own, 4 * sizeof *own);
        if (signbit(local[0]))
            for (int k = 0; k < 4; k++) local[k] = -local[k];
        for (int k = 0; k < 3; k++) {
            const double off = body->stiffness[3 * joint + k] * (2 * local[1 + k] - body->relaxed[3 * joint + k]);
            p->spring[3 * joint + k] = off;
            springs += off * off;
        }
        if (!targets->rotation_weight || targets->rotation_weight[joint] <= 0) continue;
        const double *q = targets->rotation + 4 * joint, share = sqrt(targets->rotation_weight[joint]);
        const double aim[4] = {q[0] * share, -q[1] * share, -q[2] * share, -q[3] * share};
        double *away = p->away + 4 * joint;
        multiply_quaternions(aim, own, away);
        p->cost += 4 * dot_doubles(away + 1, away + 1);
    }
    for (int32_t point = 0; point < tree->points; point++) {
        double *position = p->position + 3 * point, *bone = p->bone + 3 * point, *error = p->error + 3 * point;
        for (int k = 0; k < 3; k++) {
            bone[k] = point ? dot_doubles(p->matrix + 9 * tree->parent[point] + 3 * k, tree->rest_offset + 3 * point) : 0;
            position[k] = point ? p->position[3 * tree->parent[point] + k] + bone[k] : p->root[k];
            error[k] = position[k] - targets->position[3 * point + k];
        }
        p->cost += targets->weight[point] * dot_doubles(error, error);
    }
    p->total = p->cost + springs;
}

/* The outward pull on every bone of forces (points, 3), which become those of the points beyond; 0 if they push. */
static void measure_tension(const bs_tree *tree, const posed *p, double *force, double *tension) {
    for (int32_t point = tree->points - 1; point > 0; point--) {
        const double *sum = force + 3 * point, *offset = tree->rest_offset + 3 * point;
        const double size = fmax(sqrt(dot_doubles(offset, offset)), SHORTEST_BONE);
        tension[point] = fmax(-dot_doubles(sum, p->bone + 3 * point) / (size * size), 0);
        for (int k = 0; k < 3; k++) force[3 * tree->parent[point] + k] += sum[k];
    }
}

/* Write each joint's own part of the normal equations.
 *
 * A bone that is pulled outward, its target beyond its length, resists turning more than in the linear model: without
 * that second-order term Gauss-Newton overshoots on noisy targets. The opposite term, of pushed bones, would break
 * positive definiteness and is omitted. */
static void write_equations(const bs_posable *body, const bs_targets *targets, const posed *p, const double *tension,
                            double damping, workspace *w) {
    const bs_tree *tree = &body->tree;
    static const double ONES[3] = {1, 1, 1};
    for (int32_t joint = 0; joint < tree->joints; joint++) {
        form *own = w->forms + joint;
        memset(own, 0, sizeof *own);
        slope_of(p->matrix + 9 * joint, p->local + 4 * joint, body->stiffness + 3 * joint, w->slope + 9 * joint);
        for (int k = 0; k < 3; k++) {
            own->moves[4 * k] = targets->weight[joint];
            own->move[k] = targets->weight[joint] * p->error[3 * joint + k];
            own->turns[4 * k] = damping * body->lever[joint] * body->lever[joint];
        }
        if (!targets->rotation_weight || targets->rotation_weight[joint] <= 0) continue;
        double slope[9], transposed[9];
        slope_of(p->matrix + 9 * joint, p->away + 4 * joint, ONES, slope);
        transpose_doubles(slope, transposed);
        add_product(slope, transposed, 3, 1, own->turns);
        add_product(slope, p->away + 4 * joint + 1, 1, 2, own->turn);
    }
    for (int32_t point = 1; point < tree->points; point++) {
        form *above = w->forms + tree->parent[point];
        const double *bone = p->bone + 3 * point, *error = p->error + 3 * point;
        const double share = point < tree->joints ? 0 : targets->weight[point], square = dot_doubles(bone, bone);
        double swing[9], turned[3];
        swing_of(bone, swing);
        cross_doubles(bone, error, turned);
        for (int row = 0; row < 3; row++) { /* Sᵀ S is |b|² − b bᵀ */
            for (int column = 0; column < 3; column++) {
                const double across = (row == column ? square : 0) - bone[row] * bone[column];
                above->turns[3 * row + column] += (share + tension[point]) * across;
                above->both[3 * row + column] += share * swing[3 * row + column];
            }
            above->moves[4 * row] += share;
            above->move[row] += share * error[row];
            above->turn[row] += share * turned[row];
        }
    }
}

/* Eliminate the turn of a joint, and add what remains to its parent's equations. */
static void eliminate(const double *bone, const double *slope, const double *spring, const form *own, gain *turned,
                      form *above) {
    double matrix[9], stretch[9] = {0}, pull[3] = {0}, transposed[9], right[3 * 7], swing[9], swing_transposed[9];
    transpose_doubles(slope, transposed);
    add_product(slope, transposed, 3, 1, stretch);
    add_product(slope, spring, 1, 1, pull);
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 3; column++) {
            matrix[3 * row + column] = stretch[3 * row + column] + own->turns[3 * row + column];
            right[7 * row + column] = -own->both[3 * column + row];
            right[7 * row + 3 + column] = stretch[3 * row + column];
        }
        right[7 * row + 6] = -(own->turn[row] + pull[row]);
    }
    solve_positive(3, matrix, 7, right);
    for (int row = 0; row < 3; row++) {
        memcpy(turned->move + 3 * row, right + 7 * row, 3 * sizeof *right);
        memcpy(turned->parent + 3 * row, right + 7 * row + 3, 3 * sizeof *right);
        turned->one[row] = right[7 * row + 6];
    }

    /* The rest is a form of the joint's move and its parent's turn. */
    double moves[9], both[9] = {0}, move[3];
    memcpy(moves, own->moves, sizeof moves);
    memcpy(move, own->move, sizeof move);
    add_product(own->both, turned->move, 3, 1, moves);
    add_product(own->both, turned->parent, 3, 1, both);
    add_product(own->both, turned->one, 1, 1, move);
    for (int k = 0; k < 9; k++) above->turns[k] += stretch[k];
    add_product(stretch, turned->parent, 3, -1, above->turns);
    for (int k = 0; k < 3; k++) above->turn[k] -= pull[k];
    add_product(stretch, turned->one, 1, -1, above->turn);

    /* The joint's move is its parent's, and that of the bone. */
    swing_of(bone, swing);
    transpose_doubles(swing, swing_transposed);
    transpose_doubles(both, transposed);
    for (int k = 0; k < 9; k++) above->moves[k] += moves[k], above->both[k] += both[k];
    add_product(transposed, swing, 3, 1, above->turns);
    add_product(moves, swing, 3, 1, both);
    add_product(swing_transposed, both, 3, 1, above->turns);
    add_product(moves, swing, 3, 1, above->both);
    for (int k = 0; k < 3; k++) above->move[k] += move[k];
    add_product(swing_transposed, move, 1, 1, above->turn);
}

/* Solve the equations: the root's move and all turns. */
static void solve_equations(const bs_tree *tree, const posed *p, double damping, workspace *w) {
    for (int32_t joint = tree->joints - 1; joint > 0; joint--)
        eliminate(p->bone + 3 * joint, w->slope + 9 * joint, p->spring + 3 * joint, w->forms + joint, w->gains + joint,
                  w->forms + tree->parent[joint]);
    const form *root = w->forms;
    double matrix[36];
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 3; column++) {
            matrix[6 * row + column] = root->moves[3 * row + column] + (row == column ? damping : 0);
            matrix[6 * row + 3 + column] = matrix[6 * (3 + column) + row] = root->both[3 * row + column];
            matrix[6 * (3 + row) + 3 + column] = root->turns[3 * row + column];
        }
        w->moved[row] = -root->move[row];
        w->moved[3 + row] = -root->turn[row];
    }
    solve_positive(6, matrix, 1, w->moved);
    for (int32_t joint = 1; joint < tree->joints; joint++) {
        const gain *turned = w->gains + joint;
        const double *above = w->moved + 6 * tree->parent[joint];
        double *own = w->moved + 6 * joint;
        cross_doubles(above + 3, p->bone + 3 * joint, own);
        for (int k = 0; k < 3; k++) own[k] += above[k], own[3 + k] = turned->one[k];
        add_product(turned->move, own, 1, 1, own + 3);
        add_product(turned->parent, above + 3, 1, 1, own + 3);
    }
}

/* Move the root and turn the joints of a body: Cayley's map, never half a turn. */
static void move(const bs_tree *tree, const posed *p, const double *moved, posed *trial) {
    for (int k = 0; k < 3; k++) trial->root[k] = p->root[k] + moved[k];
    for (int32_t joint = 0; joint < tree->joints; joint++, moved += 6) {
        const double half[4] = {1, moved[3] / 2, moved[4] / 2, moved[5] / 2};
        double *turned = trial->world + 4 * joint, square = 0;
        multiply_quaternions(half, p->world + 4 * joint, turned);
        for (int k = 0; k < 4; k++) square += turned[k] * turned[k];
        for (int k = 0; k < 4; k++) turned[k] /= sqrt(square);
    }
}

/* The step treated bones as straight lines. Return the squared error of that, and the tension of the bones after it. */
static double measure_step(const bs_tree *tree, const bs_targets *targets, const posed *before, const posed *p,
                           double *force, double *tension) {
    double neglected = 0;
    memset(force, 0, 3 * sizeof *force);
    for (int32_t point = 1; point < tree->points; point++) { /* first the shortfall of each point */
        const double *bone = p->bone + 3 * point, *offset = tree->rest_offset + 3 * point;
        const double size = fmax(sqrt(dot_doubles(offset, offset)), SHORTEST_BONE);
        double swept[3];
        for (int k = 0; k < 3; k++) swept[k] = bone[k] - before->bone[3 * point + k];
        const double bulge = dot_doubles(swept, swept) * 0.5 / (size * size);
        for (int k = 0; k < 3; k++) force[3 * point + k] = force[3 * tree->parent[point] + k] + bulge * bone[k];
    }
    for (int32_t point = 0; point < tree->points; point++) {
        double *own = force + 3 * point;
        neglected += targets->weight[point] * dot_doubles(own, own);
        for (int k = 0; k < 3; k++) own[k] = targets->weight[point] * (p->error[3 * point + k] + own[k]);
    }
    measure_tension(tree, p, force, tension);
    return neglected;
}

void bs_reach_targets(const bs_posable *body, const bs_descent *descent, const bs_targets *targets, bs_reached *reached,
                      double *memory) {
    const bs_tree *tree = &body->tree;
    const size_t joints = (size_t)tree->joints, points = (size_t)tree->points;
    posed now = posed_in(tree, &memory), trial = posed_in(tree, &memory);
    workspace w = {.slope = take(&memory, 9 * joints), .moved = take(&memory, 6 * joints),
                   .force = take(&memory, 3 * points)};
    w.forms = (form *)(void *)take(&memory, FORM * joints);
    w.gains = (gain *)(void *)take(&memory, GAIN * joints);

    memcpy(now.root, reached->root, 3 * sizeof *memory);
    memcpy(now.world, reached->world, 4 * joints * sizeof *memory);
    measure(body, targets, &now);
    double sum = 0, damping = descent->damping;
    for (size_t point = 0; point < points; point++) {
        sum += targets->weight[point];
        for (size_t k = 0; k < 3; k++) w.force[3 * point + k] = targets->weight[point] * now.error[3 * point + k];
    }
    const double enough = descent->tolerance * descent->tolerance * fmax(sum, LEAST_COST);
    reached->tension[0] = 0;
    if (!reached->has_tension) measure_tension(tree, &now, w.force, reached->tension);
    for (int32_t step = 0; step < descent->steps; step++) {
        write_equations(body, targets, &now, reached->tension, damping, &w);
        solve_equations(tree, &now, damping, &w);
        move(tree, &now, w.moved, &trial);
        measure(body, targets, &trial);
        if (!(trial.total <= now.total * (1 + ROUNDING) + LEAST_COST)) {
            damping = fmin(fmax(descent->first_damping, damping * 10), descent->most_damping);
            continue;
        }
        const posed before = now;
        now = trial;
        trial = before;
        damping = fmax(descent->damping, damping * 0.1);
        if (measure_step(tree, targets, &before, &now, w.force, reached->tension) <= enough) break;
    }
    memcpy(reached->root, now.root, 3 * sizeof *memory);
    memcpy(reached->world, now.world, 4 * joints * sizeof *memory);
    memcpy(reached->local, now.local, 4 * joints * sizeof *memory);
    memcpy(reached->position, now.position, 3 * points * sizeof *memory);
    reached->cost = now.cost;
}
