/* Four quadrature encoders, all edges of both channels. */
#ifndef ENCODERS_H
#define ENCODERS_H

#include <stdint.h>

#include "pins.h"

void begin_encoders(void);

/* Copy the counts since the start; bit k of `flips` turns wheel k round. */
void read_counts(int32_t counts[WHEELS], uint8_t flips);

/* How many steps were none that an encoder makes, modulo 256: a lost edge or a loose wire. */
uint8_t count_encoder_errors(void);

#endif
