#include "safety.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <stdlib.h>
#include <util/atomic.h>

#include "clock.h"
#include "outputs.h"

#define SETTLE_MS 2          /* time that an input must keep its value to count */
#define TIMEOUT_MARGIN_MS 10 /* delay between the line and the clock */
#define LOW_FOR_TICKS 100
#define OVER_FOR_TICKS 10
#define STALL_FOR_TICKS 50
#define STALL_DUTY (FULL_DUTY / 2) /* duty at which a wheel must turn */
#define STALL_SHARE 50             /* of full speed, that it turns at least */
/* A wheel whose encoder or motor is wired the wrong way round is driven off by its own controller:
 * its speed grows against the duty, by this share of full speed within this many ticks. A person
 * who pushes it, or a slope, works against a motor that brakes, and is slower; a wheel that changes its direction
 * loses the speed that is against its duty. */
#define REVERSED_SHARE 16
#define REVERSED_WITHIN_TICKS 20
#define REVERSED_FOR_TICKS 6 /* a stone is a jerk, and over sooner */
#define LEAST_GAIN_COUNTPS 100 /* four steps of a speed that is measured over 0.04 s */
#define REVERSED_DUTY (FULL_DUTY / 32) /* less moves nothing */
#define JITTER_SHARE 256               /* of full speed, that a growing speed may lose in a tick */
#define CHANNELS 5

static volatile uint8_t causes = STOP_CAUSE_BEGAN, is_configured, waits_for_zero = 1;
static volatile uint16_t command_age_ms = COMMAND_TIMEOUT_MS;
static volatile uint8_t estop_ms, bumper_ms, is_estop, is_bumper;
static volatile uint16_t adc[CHANNELS];
static volatile uint8_t channel;
static uint16_t battery_mv, current_ma[WHEELS];
static uint8_t low_ticks, over_ticks[WHEELS], stall_ticks[WHEELS], motor_faults;
static int16_t against[WHEELS][REVERSED_WITHIN_TICKS]; /* how fast, against the duty */
static uint8_t against_ticks[WHEELS], against_at[WHEELS];

void begin_safety(void) {
  INPUT_PORT |= _BV(ESTOP_BIT) | _BV(BUMPER_BIT); /* pull-ups: an open contact is high */
  ADMUX = _BV(REFS0);
  ADCSRA = _BV(ADEN) | _BV(ADIE) | 7; /* 125 kHz: 104 us a channel */
}

ISR(ADC_vect) {
  adc[channel] = ADC;
  if (++channel == CHANNELS) channel = 0;
  ADMUX = _BV(REFS0) | channel;
  if (channel) ADCSRA |= _BV(ADSC);
}

/* Returns whether the input is pressed, after it has been so for SETTLE_MS. */
static inline uint8_t settle(uint8_t is_high, uint8_t was, volatile uint8_t *for_ms) {
  if (is_high == was) *for_ms = 0;
  else if (++*for_ms >= SETTLE_MS) return is_high;
  return was;
}

void latch_stop(uint8_t cause) {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    causes |= cause;
    switch_off();
  }
}

/* Every millisecond, in the clock's interrupt. */
void watch_inputs(void) {
  is_estop = settle((INPUT_PIN >> ESTOP_BIT) & 1, is_estop, &estop_ms);
  if (is_estop) latch_stop(STOP_CAUSE_ESTOP);
  uint8_t was = is_bumper;
  is_bumper = settle((INPUT_PIN >> BUMPER_BIT) & 1, is_bumper, &bumper_ms);
  if (is_bumper && !was) latch_stop(STOP_CAUSE_BUMPER); /* pressed on, it lets the robot back off */
  if (command_age_ms < COMMAND_TIMEOUT_MS) command_age_ms++;
  if (!may_work()) switch_off();
}

static inline uint8_t is_command_old(void) {
  return command_age_ms >= COMMAND_TIMEOUT_MS - TIMEOUT_MARGIN_MS;
}

uint8_t may_work(void) { return !causes && is_configured && !waits_for_zero && !is_command_old(); }

void note_command(uint8_t is_zero) {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { command_age_ms = 0; }
  if (is_zero && !causes) waits_for_zero = 0;
}

void note_config(void) {
  is_configured = 1;
  waits_for_zero = 1;
}

uint8_t clear_latch(uint16_t key) {
  if (key != CLEAR_KEY) return ACK_RESULT_BAD_VALUE;
  if (is_estop) return ACK_RESULT_STILL_PRESSED;
  if (low_ticks >= LOW_FOR_TICKS) return ACK_RESULT_STILL_LOW;
  waits_for_zero = 1;
  motor_faults = 0;
  for (uint8_t k = 0; k < WHEELS; k++) over_ticks[k] = stall_ticks[k] = against_ticks[k] = 0;
  causes = 0;
  return ACK_RESULT_DONE;
}

static uint16_t read_mv(uint8_t of) {
  uint16_t value;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { value = adc[of]; }
  return value * ADC_MV / 1024;
}

static void find_fault(uint8_t bit, uint8_t cause) {
  motor_faults |= bit;
  latch_stop(cause);
}

void watch_power(const board_config_t *config) {
  battery_mv = read_mv(0) * BATTERY_DIVIDER;
  uint8_t is_low = is_configured && battery_mv < config->battery_cutoff_v;
  low_ticks = !is_low ? 0 : low_ticks < LOW_FOR_TICKS ? low_ticks + 1 : low_ticks;
  if (low_ticks >= LOW_FOR_TICKS) latch_stop(STOP_CAUSE_BATTERY);
  for (uint8_t k = 0; k < WHEELS; k++) {
    int16_t off_zero_mv = read_mv(1 + k) - CURRENT_ZERO_MV;
    current_ma[k] = (uint16_t)abs(off_zero_mv) * (1000 / CURRENT_MV_PER_A);
    uint8_t is_over = config->current_limit_a && current_ma[k] > config->current_limit_a;
    over_ticks[k] = is_configured && is_over ? over_ticks[k] + 1 : 0;
    if (over_ticks[k] >= OVER_FOR_TICKS) {
      over_ticks[k] = OVER_FOR_TICKS - 1;
      find_fault(_BV(k), STOP_CAUSE_MOTOR);
    }
  }
  ADCSRA |= _BV(ADSC); /* the next round */
}

/* Whether the speed against the duty has grown by this share without a pause. */
static uint8_t grows_against(uint8_t wheel, int16_t duty, int16_t speed_countps, uint16_t full) {
  int16_t *past = against[wheel];
  uint8_t at = against_at[wheel], ticks = against_ticks[wheel];
  int32_t last = past[at], most = full / REVERSED_SHARE;
  uint8_t is_so = abs(duty) >= REVERSED_DUTY && speed_countps > 0;
  if (ticks && last - speed_countps > full / JITTER_SHARE) is_so = 0;
  if (!is_so) ticks = 0;
  else if (ticks < REVERSED_WITHIN_TICKS) ticks++;
  against_ticks[wheel] = ticks;
  at = against_at[wheel] = at + 1 == REVERSED_WITHIN_TICKS ? 0 : at + 1;
  past[at] = speed_countps;
  if (ticks < REVERSED_FOR_TICKS) return 0;
  int32_t first = past[(at + REVERSED_WITHIN_TICKS + 1 - ticks) % REVERSED_WITHIN_TICKS];
  return speed_countps - first >= (most > LEAST_GAIN_COUNTPS ? most : LEAST_GAIN_COUNTPS);
}

void watch_wheel(uint8_t wheel, int16_t duty, int16_t speed_countps, uint16_t full_speed_countps) {
  int16_t along_countps = duty < 0 ? -speed_countps : speed_countps;
  uint8_t is_stalled = abs(duty) >= STALL_DUTY &&
                       along_countps < (int16_t)(full_speed_countps / STALL_SHARE);
  stall_ticks[wheel] = is_stalled ? stall_ticks[wheel] + 1 : 0;
  if (stall_ticks[wheel] >= STALL_FOR_TICKS) {
    stall_ticks[wheel] = 0;
    find_fault(_BV(WHEELS + wheel), STOP_CAUSE_MOTOR);
  }
  if (grows_against(wheel, duty, -along_countps, full_speed_countps))
    find_fault(_BV(WHEELS + wheel), STOP_CAUSE_REVERSED);
}

void tell_safety(board_state_t *state) {
  uint8_t now_causes, is_old;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    now_causes = causes;
    is_old = is_command_old();
  }
  uint16_t flags = 0;
  if (is_estop) flags |= BOARD_FLAG_ESTOP_PRESSED;
  if (is_bumper) flags |= BOARD_FLAG_BUMPER_PRESSED;
  if (now_causes) flags |= BOARD_FLAG_STOP_LATCHED;
  if (is_old) flags |= BOARD_FLAG_NO_COMMAND;
  if (!is_configured) flags |= BOARD_FLAG_NOT_CONFIGURED;
  if (waits_for_zero) flags |= BOARD_FLAG_WAITS_FOR_ZERO;
  if (low_ticks >= LOW_FOR_TICKS) flags |= BOARD_FLAG_BATTERY_LOW;
  if (motor_faults) flags |= BOARD_FLAG_MOTOR_FAULT;
  state->flags |= flags;
  state->stop_causes = now_causes;
  state->motor_faults = motor_faults;
  state->battery_v = battery_mv;
  for (uint8_t k = 0; k < WHEELS; k++) state->current_a[k] = current_ma[k];
}
