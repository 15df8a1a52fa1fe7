/* Whether the program hung and its watchdog reset it, also where a bootloader has taken MCUSR away.
 *
 * The one that a Mega is sold with clears MCUSR and waits a second after any reset, so that a reset
 * by the watchdog looks like the button's. Memory that no start clears distinguishes them: how long the
 * main loop had been silent when the reset came. A timer's interrupt counts that, so a program that
 * hangs with its interrupts off is not found so.
 */
#ifndef HANG_H
#define HANG_H

#include <avr/io.h>
#include <stdint.h>
#include <util/atomic.h>

#define HANG_MARK 0x6B5A2D91UL /* memory that has just got its power holds it once in 2^32 */

typedef struct {
  uint32_t mark;
  uint16_t silent_ms; /* of the main loop */
} hang_t;

/* Each program has one: `volatile hang_t hang NOT_CLEARED;` */
#define NOT_CLEARED __attribute__((section(".noinit")))
extern volatile hang_t hang;

/* Every millisecond, in an interrupt. */
static inline void count_silence(void) { hang.silent_ms++; }

/* In the main loop, with its watchdog. */
static inline void end_silence(void) {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { hang.silent_ms = 0; }
}

/* At the start, before the interrupt counts. Returns MCUSR, or what it would be without a
 * bootloader; half of the watchdog's time without the main loop was a hang. */
static inline uint8_t find_reset_cause(uint16_t watchdog_ms) {
  uint8_t cause = MCUSR;
  MCUSR = 0;
  if (!cause && hang.mark == HANG_MARK && hang.silent_ms >= watchdog_ms / 2) cause = _BV(WDRF);
  hang.mark = HANG_MARK;
  hang.silent_ms = 0;
  return cause;
}

#endif
