#include "outputs.h"

#include <avr/io.h>

#include "pins.h"

/* At no duty the timer lets go of its pin, which stays low: a compare value of zero would give
 * a pulse in every period. */
#define CONNECT_3 _BV(COM3A1)
#define CONNECT_4(k) _BV(COM4A1 - 2 * (k))

void begin_outputs(void) {
  DDRA = 0x0F;
  DDRC = 0xFF;
  DDRL |= _BV(LAMP_BIT);
  DDRH |= _BV(3) | _BV(4) | _BV(5);
  DDRE |= _BV(3);
  ICR3 = ICR4 = PWM_TOP;
  TCCR3A = TCCR4A = _BV(WGM31);
  TCCR3B = TCCR4B = _BV(WGM33) | _BV(WGM32) | _BV(CS30);
}

void set_duty(uint8_t wheel, int16_t duty) {
  uint8_t is_back = duty < 0;
  uint16_t size = is_back ? -duty : duty;
  uint16_t compare = ((uint32_t)size * (PWM_TOP + 1)) >> 15;
  if (is_back) DIRECTION_PORT |= _BV(wheel);
  else DIRECTION_PORT &= ~_BV(wheel);
  switch (wheel) {
    case 0: OCR4A = compare; break;
    case 1: OCR4B = compare; break;
    case 2: OCR4C = compare; break;
    default: OCR3A = compare;
  }
  if (wheel == 3) TCCR3A = compare ? TCCR3A | CONNECT_3 : TCCR3A & ~CONNECT_3;
  else TCCR4A = compare ? TCCR4A | CONNECT_4(wheel) : TCCR4A & ~CONNECT_4(wheel);
}

void set_tool(uint8_t bits) { TOOL_PORT = bits; }

uint8_t get_tool(void) { return TOOL_PORT; }

void switch_off(void) {
  TCCR4A &= ~(CONNECT_4(0) | CONNECT_4(1) | CONNECT_4(2));
  TCCR3A &= ~CONNECT_3;
  TOOL_PORT = 0;
}
