/* Balance: a body that stands still has its centre of mass over its feet. */
#ifndef BODYSENSE_BALANCE_H
#define BODYSENSE_BALANCE_H

#include "pose_state.h"

/* Turn a predicted body about its head so that its centre of mass is nearly over the feet that stand.
 *
 * Predictions of postures that the network does not know lean, with feet that are as far as 25 cm from where they could
 * carry. A turn is found while the head is high and still, fades while it moves, and is given up if it is low or if a
 * point of the trunk or of a leg is measured. */
void balance_prediction(const tracked *t, pose_state *s, prediction *p);

#endif
