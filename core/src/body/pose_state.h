/* Memory of a person's pose between frames: jumps that are eased, lost limbs, feet that stand. */
#ifndef BODYSENSE_POSE_STATE_H
#define BODYSENSE_POSE_STATE_H

#include "../base/internal.h"
#include "ease.h"

enum limb_name { LEFT_ARM, RIGHT_ARM, LEFT_LEG, RIGHT_LEG, LIMBS };

/* State of each limb. Vectors are in the heading of the body, from the limb's start. */
typedef struct limb_state {
    ease end, middle;                   /* m, easing of wrist or ankle, elbow or knee */
    vec3 end_output, end_speed;         /* m, m/s: as output in the frame before, but for what follows */
    vec3 end_held, middle_held, end_shift, middle_shift; /* m, world: how floor, pelvis and collar moved them from their start */
    vec3 middle_output, middle_speed;   /* m, m/s */
    vec3 end_kept, end_leaving, middle_kept; /* m, m/s, m: where the end was last seen, and how fast it moved */
    float lost;                         /* s since the end was last seen; below 0: never, or not kept */
    float waned;                        /* s as `waning` counts them, by which the end is given up */
    float stood;                        /* s for which points that stand in for the end have been seen */
    uint8_t seen;                       /* 2: the end, 1: points that stand in for it, 0: neither */
    uint8_t middle_seen;
    ease pull;       /* m, easing of a shoulder that its collar gives */
    vec3 pulled, pulled_speed; /* m, m/s: how far it was given */
    uint8_t pulling; /* which measured joints of the arm pulled it */
} limb_state;

/* The axis about which elbows bend, as an angle from the vertical in the T-pose: skeletons differ by 30°. */
typedef struct hinge_state {
    float upright, tilted; /* sums of its cosine and sine, by how far elbows were bent */
} hinge_state;

/* Where the body is that feet carry: its head, from base (m), the heading of its pelvis, and the head's speed (m/s). */
typedef struct carrier {
    vec3 head;
    float cosine, sine, speed;
} carrier;

/* A step of a foot to where it is predicted. */
typedef struct foot_step {
    vec3 from;          /* m: how far the foot was held back */
    float turned;       /* rad: and turned back */
    float age, span;    /* s; a span of 0: no step */
} foot_step;

typedef struct foot_state {
    uint8_t held;   /* 0: free, 1: by the ankle, 2: by the ball */
    vec3 anchor;    /* m, from base: where the held part stands */
    vec3 slide;     /* m, along the floor: how far the foot is held back */
    vec3 ahead;     /* unit, along the floor: where the held foot points */
    float turn;     /* rad about +Y: by how much the foot is turned back */
    vec3 put_at;    /* m, from base: where the held part was put down */
    carrier put_by; /* where the body was then */
    float strain;   /* m·s by which a foot that stands is away from where it belongs */
    foot_step step;
    vec3 ball;      /* m, from base: of the foot as output */
    bool shown;     /* a ball was output */
    float lifted;   /* m, by which a foot that moves is lifted */
    float stood;    /* s since the ankle rests on the floor */
    float drop;     /* m: how far the foot is lowered onto the floor; below 0: raised */
} foot_state;

/* Decaying offset that hides a jump of the predicted rotation of one joint. */
typedef struct offset_decay {
    vec3 off, speed; /* rad, rad/s, world */
    mat3 predicted;  /* world ← joint, in the frame before */
    vec3 spin;       /* rad/s, world */
} offset_decay;

/* How far a predicted body that stands leans. */
typedef struct balance_state {
    vec3 lean;    /* where the centre of mass is from the feet, per metre over them, in the pelvis's heading: averaged */
    float stands; /* 1: the body stands, 0: it does not; eased */
    float still;  /* s for which it has stood still */
    float free;   /* so far it may lean; kept while points are measured, so that nothing jumps when they come */
} balance_state;

/* How a predicted joint is turned toward what is measured. */
typedef struct fitting {
    vec3 turn; /* rad, world, in the frame before */
    vec3 off;  /* rad: remainder of a change of it, after measured points came or went */
} fitting;

typedef struct pose_state {
    uint8_t begun;
    uint8_t has_measured_position; /* a position was measured since motion started */
    uint8_t had_position[BS_POINTS];
    uint8_t had_rotation[BODY_JOINTS];
    vec3 point[BS_POINTS];         /* m, from base, as output */
    mat3 rotation[BODY_JOINTS];    /* world ← joint, as output */
    vec3 spin[BODY_JOINTS];        /* rad/s, world */
    fitting fitting[BODY_JOINTS];
    offset_decay offset_decay[BODY_JOINTS];
    uint8_t sensors_changed;       /* in the frame before, a sensor that decides about the whole body came or went */
    ease turn[BODY_JOINTS];        /* rad, world */
    balance_state balance;
    float stance;                  /* share by which predicted legs turn with the pelvis; 0 while legs are measured */
    ease head, pelvis;             /* m, world */
    vec3 head_speed;               /* m/s */
    vec3 course;                   /* unit, horizontal: where a head faces or goes; zero before it is known */
    vec3 pelvis_bent, pelvis_speed; /* m, m/s: the pelvis before legs moved it */
    ease pull;
    vec3 pulled, pulled_speed;     /* m, m/s: by how much measured legs moved the pelvis */
    uint8_t pulling;               /* which measured joints of legs did */
    float standing_drop;           /* m, by how much the pelvis is lowered so that feet reach the floor */
    limb_state limb[LIMBS];
    hinge_state hinge;
    foot_state foot[2];
    mat3 wrist_kept[2];            /* chest's heading ← wrist when its rotation was last measured */
    float wrist_lost[2];           /* s since then; below 0: never */
} pose_state;

#endif
