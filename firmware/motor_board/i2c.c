#include "i2c.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/delay.h>

#include "pins.h"

enum { STARTED = 0x08, RESTARTED = 0x10, ADDRESS_TAKEN = 0x18, BYTE_TAKEN = 0x28,
       READING = 0x40, BYTE_MORE = 0x50, BYTE_LAST = 0x58, SILENCE = 0xFF };

static volatile uint8_t is_done;

/* The flag stays set, so that the bus waits; only the interrupt is masked. */
ISR(TWI_vect) {
  is_done = 1;
  TWCR &= ~(_BV(TWINT) | _BV(TWIE));
}

void begin_i2c(void) {
  TWBR = (F_CPU / 400000UL - 16) / 2;
  TWCR = _BV(TWEN);
}

void free_i2c(void) {
  TWCR = 0;
  for (uint8_t i = 0; i < 9 && !(PIND & _BV(SDA_BIT)); i++) {
    DDRD |= _BV(SCL_BIT); /* low, as the port's bit is zero */
    _delay_us(5);
    DDRD &= ~_BV(SCL_BIT); /* high by the resistor on the bus */
    _delay_us(5);
  }
  TWCR = _BV(TWEN);
}

/* Do one step of the bus. Returns its state. */
static uint8_t step(uint8_t control) {
  is_done = 0;
  TWCR = control | _BV(TWINT) | _BV(TWEN) | _BV(TWIE);
  for (uint16_t waited_us = 0; !is_done; waited_us++) {
    if (waited_us == I2C_WAIT_US) return SILENCE;
    _delay_us(0.5); /* and as long for the loop */
  }
  return TWSR & 0xF8;
}

/* simavr says BYTE_TAKEN of an address, too. */
static uint8_t is_taken(uint8_t state) { return state == ADDRESS_TAKEN || state == BYTE_TAKEN; }

static uint8_t send_byte(uint8_t byte) {
  TWDR = byte;
  return is_taken(step(0));
}

/* A start would take back the stop before it, if that still lasts. */
static void wait_for_stop(void) {
  for (uint8_t waited_us = 0; waited_us < 50 && (TWCR & _BV(TWSTO)); waited_us++) _delay_us(1);
}

static uint8_t select(uint8_t device, uint8_t reg) {
  wait_for_stop();
  return step(_BV(TWSTA)) == STARTED && send_byte(device << 1) && send_byte(reg);
}

static uint8_t end(uint8_t is_good) {
  TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWSTO);
  return is_good;
}

uint8_t write_register(uint8_t device, uint8_t reg, uint8_t value) {
  return end(select(device, reg) && send_byte(value));
}

uint8_t read_registers(uint8_t device, uint8_t reg, uint8_t *bytes, uint8_t count) {
  if (!select(device, reg)) return end(0);
  uint8_t state = step(_BV(TWSTA));
  if (state != RESTARTED && state != STARTED) return end(0);
  TWDR = device << 1 | 1;
  if (step(0) != READING) return end(0);
  while (count--) {
    state = step(count ? _BV(TWEA) : 0);
    if (state != BYTE_MORE && state != BYTE_LAST) return end(0);
    *bytes++ = TWDR;
  }
  return end(1);
}
