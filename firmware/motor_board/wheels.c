#include "wheels.h"

#include <stdlib.h>
#include <util/atomic.h>

#include "encoders.h"
#include "outputs.h"
#include "safety.h"

#define WINDOW 4 /* ticks over which a speed is measured: a power of two */
#define SLOWEST_FULL_SPEED 100
#define SHORTEST_TI_MS 20
#define SETPOINT_WEIGHT_16 6
#define STRONGEST_KP 1024 /* 4 */
#define INTEGRAL_MOST_256 (6L * FULL_DUTY * 256)

static board_config_t config;
static int16_t target[WHEELS];
static int32_t ramp_16[WHEELS];    /* the speed of the ramp, 16 to a count/s */
static int32_t integral_256[WHEELS]; /* 256 to a step of duty */
static int32_t past[WINDOW][WHEELS];
static uint8_t tick;

uint8_t configure_wheels(const board_config_t *wanted) {
  if (wanted->full_speed_countps < SLOWEST_FULL_SPEED ||
      wanted->max_speed_countps > INT16_MAX || wanted->max_accel_countps2 == 0 ||
      wanted->ti_s < SHORTEST_TI_MS || wanted->kp_ratio > STRONGEST_KP)
    return 0;
  if (wanted->encoder_flips != config.encoder_flips) { /* counts that turned round are no motion */
    for (uint8_t i = 0; i < WINDOW; i++) read_counts(past[i], wanted->encoder_flips);
  }
  config = *wanted;
  note_config();
  return 1;
}

const board_config_t *get_config(void) { return &config; }

static int32_t limit(int32_t value, int32_t most) {
  return value > most ? most : value < -most ? -most : value;
}

void set_speeds(const int16_t speed_countps[WHEELS]) {
  uint8_t is_zero = 1;
  for (uint8_t k = 0; k < WHEELS; k++) {
    target[k] = limit(speed_countps[k], config.max_speed_countps);
    if (speed_countps[k]) is_zero = 0;
  }
  note_command(is_zero);
}

/* A speed as a share of full, FULL_DUTY to one; more than that is cut off. */
static int32_t as_share(int32_t countps) {
  return limit(countps * FULL_DUTY / (int32_t)config.full_speed_countps, FULL_DUTY);
}

/* The voltage of the wanted speed, an integral of the error, and against them a share of the speed
 * itself. The wanted speed gives back only a part of it: so a step overshoots little, whatever
 * the inertia of the wheel. While the duty is at its limit the integral does not push on.
 * Source: K. J. Astrom and T. Hagglund, Advanced PID Control (2006), 3.4 (setpoint weight), 3.5. */
static int16_t control(uint8_t k, int16_t speed) {
  int32_t step_16 = (int32_t)config.max_accel_countps2 * 10 * 16 / TELEMETRY_HZ;
  ramp_16[k] += limit((int32_t)target[k] * 16 - ramp_16[k], step_16);
  int32_t wanted = ramp_16[k] / 16;
  if (target[k] == 0 && wanted == 0 && labs(as_share(speed)) < FULL_DUTY / 100) {
    integral_256[k] = 0; /* at rest no current holds it */
    return 0;
  }
  int32_t against_256 = config.kp_ratio * as_share(speed - wanted * SETPOINT_WEIGHT_16 / 16);
  int32_t duty = as_share(wanted) + (integral_256[k] - against_256) / 256;
  int32_t error_256 = config.kp_ratio * as_share(wanted - speed);
  if (labs(duty) <= FULL_DUTY || (duty > 0) != (error_256 > 0))
    integral_256[k] += error_256 / config.ti_s * (1000 / TELEMETRY_HZ);
  integral_256[k] = limit(integral_256[k], INTEGRAL_MOST_256);
  return limit(duty, FULL_DUTY);
}

void run_wheels(board_state_t *state) {
  int32_t *before = past[tick++ & (WINDOW - 1)], counts[WHEELS];
  read_counts(counts, config.encoder_flips);
  uint8_t is_on;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { is_on = may_work(); }
  for (uint8_t k = 0; k < WHEELS; k++) {
    int16_t speed = limit((counts[k] - before[k]) * (TELEMETRY_HZ / WINDOW), INT16_MAX);
    before[k] = counts[k];
    int16_t duty = 0;
    if (is_on) {
      duty = control(k, speed);
    } else {
      ramp_16[k] = (int32_t)speed * 16; /* from what it rolls at, when it may again */
      integral_256[k] = 0;
    }
    watch_wheel(k, duty, speed, config.full_speed_countps);
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
      if (!may_work()) duty = 0;
      set_duty(k, config.motor_flips & (1 << k) ? -duty : duty);
    }
    state->counts[k] = counts[k];
    state->speed_countps[k] = speed;
    state->duty_ratio[k] = (int32_t)duty * 100 / FULL_DUTY;
  }
}
