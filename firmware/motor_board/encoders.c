#include "encoders.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

static volatile int16_t raw[WHEELS];
static volatile uint8_t errors;
static uint8_t last_pins;
static int16_t last_raw[WHEELS];
static int32_t total[WHEELS];

/* Both channels as they were (high bits) and are: the way that the disc went. 2 is no way. */
static const int8_t STEPS[16] = {0, 1, -1, 2, -1, 0, 2, 1, 1, 2, 0, -1, 2, -1, 1, 0};

static inline void count_step(uint8_t wheel, uint8_t before, uint8_t now) {
  int8_t step = STEPS[(before & 3) << 2 | (now & 3)];
  if (step == 2) errors++;
  else raw[wheel] += step;
}

ISR(PCINT0_vect) {
  uint8_t now = ENCODER_PIN, before = last_pins, changed = now ^ before;
  last_pins = now;
  if (changed & 0x03) count_step(0, before, now);
  if (changed & 0x0C) count_step(1, before >> 2, now >> 2);
  if (changed & 0x30) count_step(2, before >> 4, now >> 4);
  if (changed & 0xC0) count_step(3, before >> 6, now >> 6);
}

void begin_encoders(void) {
  ENCODER_DDR = 0; /* a bootloader blinks with one of them */
  ENCODER_PORT = 0xFF; /* pull-ups, for encoders with open collectors */
  last_pins = ENCODER_PIN;
  PCMSK0 = 0xFF;
  PCICR |= _BV(PCIE0);
}

void read_counts(int32_t counts[WHEELS], uint8_t flips) {
  for (uint8_t k = 0; k < WHEELS; k++) {
    int16_t now;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { now = raw[k]; }
    total[k] += (int16_t)(now - last_raw[k]);
    last_raw[k] = now;
    counts[k] = flips & _BV(k) ? -total[k] : total[k];
  }
}

uint8_t count_encoder_errors(void) { return errors; }
