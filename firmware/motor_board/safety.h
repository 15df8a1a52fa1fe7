/* Whether wheels and tool may work: inputs, latch, age of the command, battery and currents. */
#ifndef SAFETY_H
#define SAFETY_H

#include <stdint.h>

#include "../wire.h"
#include "pins.h"

void begin_safety(void);

/* To be called when a WheelCommand was taken, and when the board was configured. */
void note_command(uint8_t is_zero);
void note_config(void);

/* Latch the stop, for one more cause. */
void latch_stop(uint8_t cause);

/* Clear the latch as the host asks. Returns the result that the answer carries. */
uint8_t clear_latch(uint16_t key);

/* Whether motors and tool may work now. Call with interrupts off where outputs follow. */
uint8_t may_work(void);

/* Once a tick: look at battery and currents, and at which wheels should turn but do not,
 * or turn against their motor; a duty of 0 where the motors are off. */
void watch_power(const board_config_t *config);
void watch_wheel(uint8_t wheel, int16_t duty, int16_t speed_countps, uint16_t full_speed_countps);

/* Write the safety part of a state. */
void tell_safety(board_state_t *state);

#endif
