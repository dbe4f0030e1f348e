/* Fitting: the predicted body is drawn onto measured points, before limbs meet them exactly. */
#ifndef BODYSENSE_FIT_H
#define BODYSENSE_FIT_H

#include "pose_state.h"

/* Turn the predicted joints so that the whole body is near what is measured. Predicted contacts and errors stay. */
void fit_prediction(const tracked *t, pose_state *s, prediction *p);

#endif
