/* Every tuned number of the core: unit, meaning, and how it was fitted.
 *
 * Numbers were chosen by hand, unless a comment says what they were fitted on, and what other values gave. Rates and
 * spans are in seconds, so that results hardly depend on the rate of frames. A change of any of them changes the golden
 * run (`make golden`); core/test/tuned.h measures what they do.
 *
 * Not here: sizes of arrays, versions and bits (whole numbers), guards against division by zero (1e-6 and the like),
 * mathematical constants (base/maths.h). */
#ifndef BODYSENSE_CONSTANTS_H
#define BODYSENSE_CONSTANTS_H

/* ---- what is accepted -------------------------------------------------------------------------------------------- */

#define INPUT_FARTHEST 1000.0  /* m: beyond it single precision is too coarse for a body */
#define INPUT_UNIT 0.01        /* a quaternion's length may differ from 1 by this */
#define INPUT_FINEST 1e-4      /* m: no point counts as more accurate */
#define INPUT_COARSEST 1000.0  /* m: or as less */
#define SETTING_LONGEST_EASE 10.0 /* s; beyond these limits single precision overflows */
#define SETTING_SHORTEST_INTERVAL 1e-4
#define SETTING_LONGEST_INTERVAL 10.0
#define PERSON_SHORTEST 1.0    /* m */
#define PERSON_TALLEST 2.3     /* m */
#define SKELETON_SOLE 0.05     /* m: a skeleton's lowest points are above the sole by as much */

/* ---- what the networks were trained with: other values need new weights ------------------------------------------ */

#define REFERENCE_HEAD 1.5F            /* m, of the head joint of the reference stature above the soles */
#define FEATURE_FINEST 1e-4F           /* m: no point is more accurate */
#define FEATURE_FASTEST 5.0F           /* m/s at the reference stature: faster points count as this */
#define FEATURE_SWIFTEST 15.0F         /* 1/s: change of axes */
#define FEATURE_STRONGEST 50.0F        /* m/s² at the reference stature */
#define FEATURE_REACH 16.0F            /* no feature is larger */
#define FEATURE_BONE_SCALE 20.0F       /* 1/m: 5 cm are 1 */
#define FEATURE_ACCELERATION_SCALE 0.1F /* s²/m */
#define HAND_FASTEST 5.0F              /* m and m/s: places and velocities of wrists that are larger count as this */
#define HAND_BONE_SCALE 10.0F          /* of the size of a hand: a tenth of it is 1 */
#define USUAL_RATE 30.0F               /* 1/s: an interval of 1/30 s is 1 */
#define SHORTEST_LINE 0.1F             /* m: a shorter line from right to left gives no heading */
#define MEMORY_INTERVAL (1.0F / 65.0F) /* s: memories advance no sooner; training has 60 Hz at most */
#define BODY_ERROR_BIAS (-3.0F)        /* of the expected error before it is made positive */
#define BODY_LEAST_ERROR 0.002F        /* m at the reference stature */
#define FINGER_ERROR_BIAS (-4.0F)
#define FINGER_LEAST_ERROR 0.001F      /* m */
#define TRACKED_ERROR 0.001F           /* m: stands for the expected error of points that are tracked */
#define TRACKED_UNLIKE 0.01F           /* stands for how much predictions of tracked joints differ */
#define LEAST_UNLIKE 0.003F            /* the predictions for a body and its mirror image differ by no less */

/* ---- bounds of errors -------------------------------------------------------------------------------------------- */

#define NORMAL_BOUND 1.567F    /* 90 % quantile of the length of normal errors in space, by their mean: not tuned */
/* People whose heads are low, or far from upright, are rare in recordings, and predictions err more than the map of
 * errors knows. Chosen on scripted poses and validation people. */
#define BOUND_LOW_FROM 0.8F    /* of the standing height: bounds grow below */
#define BOUND_LOW_AT 0.5F      /* until here */
#define BOUND_LOW_MORE 0.5F    /* share by which bounds of such a low head are larger */
#define BOUND_TILTED_FROM 0.9F /* cosine of the head's tilt: bounds grow below */
#define BOUND_TILTED_MORE 0.8F /* share by which bounds of a head that lies are larger */
/* A prediction that is farther from measured joints than expected errs by as much more elsewhere: of people whom the
 * network has never seen, in motions that it does not know. Chosen on validation scenes and on people of another
 * laboratory, whose measured joints are up to 4 expected distances off. */
#define MISSED_MOST 4.0F /* predicted errors grow by no larger factor */

/* ---- proportions ------------------------------------------------------------------------------------------------- */

#define LENGTH_BIN 0.005       /* m: lengths are counted in bins */
#define LENGTH_INTERVAL 0.1    /* s between two looks at lengths */
#define LENGTH_VAGUE 0.06      /* m: points that err more together measure nothing */
#define LENGTH_SURE 0.5F       /* quantile of a length between two measured joints of a bone */
#define LENGTH_LEG 0.95F       /* quantile of legs, spines and heads, which are bent most of the time */
#define LENGTH_ARM 0.98F       /* and of arms, which are bent even more */
#define NOISE_BONE 0.006F      /* m, standard deviation of a bone's measured length */
#define NOISE_HAND 0.004F      /* m, of a hand's */
#define NOISE_SHOULDERS 0.01F  /* m, of the distance of shoulders, which move */
#define NOISE_LEG 0.02F        /* m, of a leg's or a spine's quantile */
#define NOISE_ARM 0.03F        /* m, of an arm's or a head's height */
#define SLACK_LEG 0.01F        /* m by which the quantile of a leg or a spine is shorter than the rest pose */
#define SLACK_ARM 0.02F        /* m, of an arm */
#define BODY_INTERVAL 0.5      /* s between two fits of the body */
#define BODY_HALF_LIFE 0.4     /* s in which half of what the body in use lacks is made up */
#define UNKNOWN_LEG 0.06       /* m: deviations of a leg's bones together are more if nothing is known */
#define ADULT_SHORTEST 1.45    /* m, statures of the shape space: others are scaled */
#define ADULT_TALLEST 2.05
#define SHAPE_STEPS 20         /* of Gauss-Newton at most; about five are needed */

/* Stature from the height of a head. Statures are those of adults, seats those of chairs and sofas. */
#define STANDING_STOOP 0.02    /* m by which people stand lower than at rest */
#define WALKING_BOB 0.06       /* m, of a walker's head, from top to bottom */
#define UPRIGHT_SECONDS 1.0    /* s that a head must have been so high */
#define STATURE_MEAN 1.695     /* m */
#define STATURE_DEVIATION 0.09 /* m */
#define STANDING_NOISE 0.03    /* m, standard deviation of a standing head's height */
#define SEATED_HEAD 1.19       /* m, head's joint of a seated adult, whose seat is the higher the taller they are */
#define SEATED_SLOPE 0.7       /* m of that a metre of stature */
#define SEATED_NOISE 0.035     /* m, standard deviation: seats differ */
#define LOW_HEAD 1.15          /* m: a lower head may be that of anybody who kneels or crouches */
#define LOW_LIKELIHOOD 0.75    /* logarithm of that, on the scale of the other two */
#define HIGH_HEAD 1.95         /* m: a higher head is on stairs, or over a floor of another height */
#define WALK_LAG 1.0           /* s by which the place where a head has been follows it */
#define WALK_AHEAD 0.6         /* m between the two of a walker; a body that leans out of a chair stays nearer */
#define WALK_FARTHEST 4.0      /* m: farther is an error of tracking */
#define WALK_SECONDS 0.5       /* s of walking that make a seat e times less likely */
#define SEAT_MISTAKEN 0.1      /* m by which a guess from a seat was too tall for a body that then walks */
#define HEIGHT_TIPTOE 0.08     /* m by which a head may be higher than at rest: shoes, tiptoe */
#define HEIGHT_CONTRADICTED 2.0 /* s after which a known height that is too low counts no more */
#define SHRINK_SECONDS 3.0     /* s after which a body does not shrink any more */
#define SHRINK_MOST 0.015      /* m by which it may */
#define GROWTH_MOVES 0.2       /* m/s, of the head: a faster one belongs to a body that moves */
#define GROWTH_STILL 0.02      /* m/s, of the stature of a still wearer, who does not visibly grow */
#define GROWTH_MOVING 0.1      /* m/s, of others, and toward a height that is known */

/* ---- mounts of trackers ------------------------------------------------------------------------------------------ */

#define MOUNT_INTERVAL 0.1     /* s between two looks */
#define MOUNT_HALF_LIFE 2.0    /* s in which half of a correction comes into use */
#define MOUNT_NOISE 0.01       /* m, standard deviation of a distance: joints are no ball joints, straps give */
#define MOUNT_SHORT_NOISE 0.1  /* m, of a leg that is shorter than it may be: it may be bent */
#define MOUNT_BENT 0.01        /* m; a straight leg may seem shorter by this and by the uncertainty of its length */
#define MOUNT_FARTHEST 4.0     /* standard deviations from what is expected: farther is an error of tracking */
#define MOUNT_MOST 0.05        /* m, along each axis: a correction beyond is an error, too */
#define MOUNT_BONE_LEAST 0.001 /* m, standard deviation of a bone */
#define MOUNT_SLIP 1e-4        /* m/√s by which straps slip */

/* ---- jumps ------------------------------------------------------------------------------------------------------- */

#define BLEND 0.25F            /* s in which predicted joints are eased after sensors of their group came or went */
#define EASE_RAMP 0.2F         /* of the span: what an offset takes to get up speed, and to lose it */
#define EASE_FASTER (1.0F / (1.0F - EASE_RAMP)) /* highest speed of an offset relative to its mean speed */
#define EASE_FASTEST 10.0F     /* m/s: no offset goes faster, its span is longer instead */
/* Rotations that the network predicts. Chosen on validation people. */
#define OFFSET_HALF_LIFE 0.1F  /* s in which an offset at rest halves */
#define OFFSET_TRUSTED 0.7F    /* share of a joint's spin that remains after each frame with a change of sensors */
#define OFFSET_CARRIED 0.5F    /* share of the change of a joint's spin that is made gradual */

/* ---- head and trunk ---------------------------------------------------------------------------------------------- */

#define COURSE_SPEED 0.4F      /* m/s along the floor: a head that sways or looks about is slower, a walker's faster */
#define COURSE_HALF_LIFE 0.5F  /* s in which half of a change of course is followed: as long as a step */
#define SPINE_BACK 0.3F        /* of its length: how far a straight spine bends backward first */
#define SPINE_LEAST_MOVE 1e-4F /* m: the spine is not bent for less, which rounding alone may ask for */
#define FIT_ROUNDS 16          /* passes over bones and measured joints */
#define FIT_DOUBT 25.0F        /* 1/m: a point 4 cm off draws half as far as a sure one */
#define FIT_FADE 0.25F         /* s in which 63 % of a change fades after a measured point came or went */
/* Share of a correction that a joint takes, relative to the other joint of its constraint. Limbs give way, the trunk
 * hardly does. Chosen on validation people, where halves and doubles of these numbers differ by less than 1 %. */
#define GIVES_TRUNK 0.2F
#define GIVES_HEAD 0.02F
#define GIVES_SHOULDER 0.3F
#define GIVES_LIMB 1.0F

/* ---- limbs ------------------------------------------------------------------------------------------------------- */

#define LIMB_STRAIGHT 0.9995F  /* of a limb's length: a limb is never quite straight */
/* As a share of a limb's length: weight of the natural side in the direction of an unmeasured middle joint. It decides
 * for nearly straight limbs. Chosen on validation people. */
#define ARM_BENT 0.03F
#define LEG_BENT 0.1F
#define KNEE_HINGE 2.0F        /* weight of measured pelvis and foot for a knee, relative to the network */
/* Sine of an elbow's angle: up to the first an arm is too straight to say about which axis it bends, from the second on
 * it says so. Chosen on validation people, where halves and doubles change elbows by less than 0.1°. */
#define HINGE_FROM 0.1F
#define HINGE_FULL 0.35F
/* Sums of a hinge before anything was learned: 11° from the vertical, between CMU's 30° and -8° to 0 of avatars. */
#define HINGE_UPRIGHT 0.49F
#define HINGE_TILTED 0.1F
#define HINGE_RATE 30.0F       /* 1/s */
#define HINGE_MOST 300.0F      /* as much as 10 s of bent elbows: a session may go on for hours */
#define COLLAR_DOUBT 25.0F     /* 1/m: a shoulder 4 cm off turns its collar half as far as a sure one */
#define COLLAR_GIVES 0.8F      /* of a collar's length: what it gives an arm that is too short */
#define WRIST_KEPT 10.0F       /* s: a lost hand mostly keeps its rotation */

/* A lost wrist or ankle keeps its velocity for a moment, and is blended into the prediction. Half of the distance
 * remains after these times. Chosen on validation people; low hands on scripted scenes, where with LOST_ARM a hand that
 * hung rises by 40 cm while the other one reaches up. Recorded hands that gesture or swing are higher or faster. */
#define LOST_LEAVING 0.08F     /* s in which 63 % of a lost end's velocity fades */
#define LOST_LEG 0.12F         /* s */
#define LOST_ARM 0.35F         /* s */
#define LOST_RAISED 3.0F       /* s, of a raised arm, as long as the head moves */
#define LOST_LOW 1.0F          /* s, of a hand that hung and rested */
#define RAISED_FROM (-0.1F)    /* of an arm's length over the shoulder: a higher wrist is raised */
#define RAISED_SPAN 0.4F       /* of it: so much higher it is raised in full */
#define LOW_HAND (-0.5F)       /* of an arm's length over the shoulder: a lower wrist hangs */
#define LOW_HAND_SPAN 0.2F     /* of it: so much lower it hangs in full */
#define LOW_HAND_SPEED 0.3F    /* m/s: a faster wrist does not rest */
#define ARM_STEEPEST 3.0F      /* m/s: largest difference of speed between a hand and its goal when it is found or lost.
                                  Feet swing too fast for it */
/* A head that moves contradicts that arms stay raised. Chosen on validation people. */
#define HEAD_STIRRED 0.1F      /* m/s: so fast it does so in full */
#define HEAD_CALM 0.1F         /* share for a still head */

/* ---- whether feet carry a body ----------------------------------------------------------------------------------- */

#define HEAD_LOW 0.71F         /* of a standing head's height: a lower head sits low, kneels or lies */
#define HEAD_SEATED 0.76F      /* of it: a higher head stands, or sits on a chair */
#define HEAD_STRETCHED 0.92F   /* of it: a body lands from a jump with a head that is higher */
#define HEAD_OVER 0.03F        /* m: a head that is higher than standing by more belongs to a body that jumps */
#define HEAD_STEADY 0.7F       /* m/s: so does one that moves faster up or down */
#define HEAD_FALLING 2.0F      /* m/s, of a head that goes down below HEAD_STRETCHED: a slower one sits or crouches */
#define PELVIS_LOW 0.75F       /* of a standing pelvis's height: sitting people have it lower */
#define PELVIS_BOWS 0.85F      /* of it: bowing people keep it higher */
#define KNEE_DOWN 0.12F        /* m over the floor: a lower knee is on the floor, with its shin */
#define KNEE_UP 0.2F           /* m: a higher one may carry */
#define SHIN_STEEP 0.1F        /* of a shin's length along the floor: a steeper one is laid backward */
#define PELVIS_PULLS 6         /* times that measured legs pull a pelvis */
#define PELVIS_MOST_SHIFT 0.15F /* m, largest shift of the pelvis toward targets out of reach */
#define PELVIS_SETTLE 0.06F    /* s in which half of what a standing pelvis lacks is made up */

/* ---- balance ----------------------------------------------------------------------------------------------------- */

/* Fitted on validation people, on UNOC's recordings and on scripted validation scenes. */
#define BALANCE_FREE 0.04F     /* m; so far the centre of mass may be from the middle of the feet. 0.03: errors on CMU's
                                  people, who stoop, grow by 1.6 % */
#define BALANCE_LOW 0.85F      /* of a standing head's height: people with lower heads sit, kneel or bow */
#define BALANCE_STANDS 0.92F   /* of it: with higher heads they stand */
#define BALANCE_STILL 0.15F    /* m/s along the floor: a head that is slower stands still */
#define BALANCE_MOVING 0.45F   /* m/s: a head that is faster walks. 0.3: feet of real headsets glide a fifth more often */
#define BALANCE_FIRST 0.3F     /* s in which half of a lean is found when a body stops, or forgotten when it goes on */
#define BALANCE_HALF_LIFE 4.0F /* s, of a body that has stood for as long. 0.5: feet follow a swaying head and glide */
#define BALANCE_CENTRE 0.45F   /* of a segment, from its start: its centre of mass (Winter 2009: 0.43 to 0.5) */
#define BALANCE_IN_AIR 0.05F   /* probability of contact that is added: feet in the air carry if none stands */
#define BALANCE_OVER 0.1F      /* m over the feet; a lower centre of mass is not that of a body that stands */
#define BALANCE_FADE 3.0F      /* s in which half of a lean is given up while the head moves */

/* ---- stance ------------------------------------------------------------------------------------------------------ */

#define STANCE_FADE 0.3F       /* s in which half of the turn fades when legs are measured, so that they do not jump */
#define STANCE_TURNED 0.2F     /* rad; so far the feet may be turned from the pelvis. Half of recorded feet are within 0.1,
                                  nine of ten within 0.35 */

/* ---- feet that are held ------------------------------------------------------------------------------------------ */

/* Feet and steps were fitted on recorded clips of validation people, on scripted validation scenes and on recorded
 * headsets, so that feet glide in fewer frames and false steps, jumps and errors are nearly those of dragged feet. */
#define FOOT_HOLD 0.5F         /* probability of contact from which a foot is held */
#define FOOT_RELEASE 0.1F      /* and below which it is let go */
#define FOOT_SURE 0.7F         /* probability of contact from which a foot is put on the floor entirely */
#define FOOT_FADE 0.16F        /* s in which half of what a released foot was held back by fades */
#define FOOT_RETURN_SPEED 0.5F /* m/s; a released foot gives that back no faster. Without it: more jumps */
#define FOOT_LEVEL 0.3F        /* of a foot: a steeper one points nowhere */
#define FOOT_LEAK 6.0F         /* s in which half of what a standing foot is held back by is given up */
#define FOOT_SETTLE 0.06F      /* s in which half of a foot's height over the floor is taken away */
#define FOOT_SOLE 0.01F        /* m: a foot that is over its rest height by less stands: recorded feet do */
#define FOOT_STILL 0.6F        /* of FOOT_SOLE: it is smaller by as much for people who stand still */
#define FOOT_FLAT_FROM 0.15F   /* s: a foot that stands on its heel for longer is flat, in full after twice that */
#define FOOT_FLAT_UNTIL 0.3F   /* probability of an ankle's contact until which it goes on to be flat */
#define FOOT_REACH 0.25F       /* m: a foot is moved no farther up or down to the floor */
#define FOOT_DRAG 0.04F        /* m; a foot that its leg drags farther slides along, while the other one moves */
#define FOOT_DRAG_STANDING 0.13F /* m; so far, if both feet stand: a foot steps before. 0.14: knees bend backward */
#define FOOT_MOST_TURN 0.6F    /* rad; a standing foot that is turned farther turns along. 0.35: who turns glides */
#define FOOT_TURN_LEAK 3.0F    /* s in which half of a standing foot's turn is given up. 1: who turns glides */
/* A foot that its leg drags along is lifted. Without it, feet of real headsets glide in 4 to 11 % of calm frames. */
#define FOOT_LIFT 0.028F       /* m, of a foot that moves. 0.025: feet of hanging hands glide in 3.1 % of frames, not 2.8 */
#define FOOT_MOVES 0.05F       /* m/s; a faster foot moves, in full at twice that. 0.08: gliding of calm heads is 1.5 to 5 % */
#define FOOT_LAG 0.01F         /* s in which half of a foot's way is followed, by which its speed is known. 0: at 144 Hz,
                                  noise of 1 mm lifts standing feet by 6 mm */
#define FOOT_DESCENT 4.0F      /* of the way to where a foot is measured; one that is eased there is no higher. 2: feet that
                                  cameras find glide a quarter more often */
#define FOOT_RISE 0.5F         /* m/s; it rises no faster. 0.4: feet of hanging hands glide a tenth more often; 0.6: shins
                                  that are found again jump by over 5 degrees */
#define FOOT_LAND 0.05F        /* s in which half of it is given up. 0.025 and 0.1: as much gliding; shins jump alike */
#define FOOT_CALM 0.3F         /* m/s, of the head: under a calmer one, feet that move are lifted in full. 0.15: feet of a
                                  head alone glide in 0.28 % of frames, not 0.03 */
#define FOOT_WALKS 0.6F        /* m/s; feet under a faster one roll, and are not lifted: their knees would bend by a degree */

/* ---- steps ------------------------------------------------------------------------------------------------------- */

#define STEP_SWAY 0.06F        /* m; as far as bodies move over feet that stay. 0: a third more false steps */
#define STEP_LEAST 0.04F       /* m; a foot of doubtful contact strains if it is farther from where it belongs */
#define STEP_LEAST_SURE 0.12F  /* m; so does a foot of sure contact. 0.08: a third more false steps on recordings */
#define STEP_LOOSE 0.3F        /* probability of contact up to which contact is doubtful */
#define STEP_SURE 0.9F         /* and from which it is sure: that of people who stand still */
#define STEP_STRAIN 0.015F     /* m·s; a foot that strains more steps: 10 cm too far for 0.15 s. 0.008: false steps; 0.03:
                                  a sixth more steps are missing in turns and shuffles */
#define STEP_DRAGGED 1.0F      /* s; a foot that its leg drags by 2 cm steps. 0: feet of real headsets glide half as often
                                  again. 2: more false steps of the head alone */
#define STEP_SPAN 0.35F        /* s; a step lasts as long at least. 0.3: knees jump by over 5 cm a frame */
#define STEP_SPEED 0.4F        /* m/s; mean speed of a long step, as which it lasts longer */
#define STEP_TOE 0.2F          /* m; the toe's distance from the ankle: a turning foot moves by as much for a radian */
#define STEP_LIFT 0.04F        /* m; height of a step. 0.05: knees jump by over 5 cm a frame */
#define STEP_RISE 0.2F         /* of a step; the foot rises before it goes along the floor, and lands after it */
#define STEP_RADIUS 0.5F       /* m; a foot that is turned by a radian strains as if it were as far away. 0.15: three of
                                  four steps are missing in turns on the spot. 0.6: people who look about step */

#endif
