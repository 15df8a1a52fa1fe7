/* The speed of each wheel: a ramp, what the motor needs for it, and a PI controller for the rest. */
#ifndef WHEELS_H
#define WHEELS_H

#include <stdint.h>

#include "../wire.h"
#include "pins.h"

/* Take a configuration. Returns whether its values make sense. */
uint8_t configure_wheels(const board_config_t *config);
const board_config_t *get_config(void);

void set_speeds(const int16_t speed_countps[WHEELS]);

/* Once a tick: count, control, and write both into the state. */
void run_wheels(board_state_t *state);

#endif
