/* Tuned numbers of feet that stand and step: unit, meaning, and how each was fitted.
 *
 * Steps were fitted on recorded clips of validation people, on scripted validation scenes and on recorded headsets, so
 * that feet glide in fewer frames and false steps, jumps and errors are nearly those of feet that are dragged. */
#ifndef BODYSENSE_CONSTANTS_H
#define BODYSENSE_CONSTANTS_H

/* ---- steps ------------------------------------------------------------------------------------------------------- */

#define STEP_SWAY 0.06F  /* m; as far as bodies move over feet that stay. 0: a third more false steps on recordings */
#define STEP_LEAST 0.04F /* m; a foot of doubtful contact strains if it is farther from where it belongs */
#define STEP_LEAST_SURE 0.12F /* m; so does a foot of sure contact. 0.08: a third more false steps on recordings */
#define STEP_LOOSE 0.3F  /* probability of contact up to which contact is doubtful */
#define STEP_SURE 0.9F   /* and from which it is sure: that of people who stand still */
#define STEP_STRAIN 0.03F /* m·s; a foot that strains more steps: 10 cm too far for 0.3 s. 0.008: false steps */
#define STEP_SPAN 0.35F  /* s; a step lasts as long at least. 0.3: knees jump by over 5 cm a frame */
#define STEP_SPEED 0.4F  /* m/s; mean speed of a long step, as which it lasts longer */
#define STEP_TOE 0.2F    /* m; the toe's distance from the ankle: a turning foot moves by as much for a radian */
#define STEP_LIFT 0.035F /* m; height of a step. 0.05: knees jump by over 5 cm a frame, as straight legs bend fast */
#define STEP_RISE 0.2F   /* of a step; the foot rises before it goes along the floor, else it glides at first */
#define STEP_RADIUS 0.15F /* m; a foot that is turned by a radian strains as if it were as far away */

/* ---- feet that are held ------------------------------------------------------------------------------------------ */

#define DRAG 0.04F       /* m; a foot that its leg drags farther slides along, while the other one moves */
#define DRAG_STANDING 0.13F /* m; so far, if both feet stand: a foot steps before. 0.14: knees bend backward */
#define RETURN_SPEED 0.5F /* m/s; a released foot gives back what it was held by no faster. Without it: more jumps */
#define MOST_TURN 0.35F  /* rad; a standing foot that is turned farther turns along. 0.6: rotations 1.5 % worse */
#define TURN_LEAK 1.0F   /* s in which half of a standing foot's turn is given up. 6: rotations 1 % worse */

#endif
