#include "clock.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "../hang.h"

static volatile uint32_t ms;

ISR(TIMER2_COMPA_vect) {
  ms++;
  count_silence();
  watch_inputs();
}

/* Timer 2 counts to 250 at 250 kHz. */
void begin_clock(void) {
  TCCR2A = _BV(WGM21);
  OCR2A = 249;
  TCCR2B = _BV(CS22);
  TIMSK2 = _BV(OCIE2A);
}

uint32_t now_ms(void) {
  uint32_t now;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { now = ms; }
  return now;
}

uint32_t now_us(void) {
  uint32_t now;
  uint8_t ticks;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    now = ms;
    ticks = TCNT2;
    if ((TIFR2 & _BV(OCF2A)) && ticks < 128) now++; /* the millisecond has just ended */
  }
  return now * 1000UL + 4UL * ticks;
}
