/* A millisecond clock, and what has to be looked at in every millisecond. */
#ifndef CLOCK_H
#define CLOCK_H

#include <stdint.h>

void begin_clock(void);
uint32_t now_ms(void);
uint32_t now_us(void);

/* Called by the clock's interrupt; safety.c has it. */
void watch_inputs(void);

#endif
