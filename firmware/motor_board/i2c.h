/* The I2C bus at 400 kHz: no call waits longer than I2C_WAIT_US for an answer. */
#ifndef I2C_H
#define I2C_H

#include <stdint.h>

#define I2C_WAIT_US 1000

void begin_i2c(void);

/* Free a bus that a device holds down, as one does that was reset in the middle of a byte. */
void free_i2c(void);

/* Both return whether the device answered. */
uint8_t write_register(uint8_t device, uint8_t reg, uint8_t value);
uint8_t read_registers(uint8_t device, uint8_t reg, uint8_t *bytes, uint8_t count);

#endif
