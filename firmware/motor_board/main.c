/* The motor board: four wheels, their safety, the tool and an IMU, on an Arduino Mega 2560.
 * What it does and how it is wired: docs/firmware.md.
 */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#include "../frames.h"
#include "../hang.h"
#include "clock.h"
#include "encoders.h"
#include "i2c.h"
#include "imu.h"
#include "line.h"
#include "outputs.h"
#include "safety.h"
#include "wheels.h"

#define TICK_MS (1000 / TELEMETRY_HZ)

#define WATCHDOG_MS 120

volatile hang_t hang NOT_CLEARED;
static uint8_t reset_cause, command_seq, wanted_tool;

static void answer(const uint8_t *message, uint8_t result) {
  board_ack_t ack = {.type = TYPE_BOARD_ACK, .of_type = message[0], .of_seq = message[1],
                     .result = result};
  send_message(&ack, sizeof ack);
}

static void tell_version(void) {
  board_version_t version = {.type = TYPE_BOARD_VERSION, .protocol = PROTOCOL,
                             .board = BOARD_KIND_MOTOR, .layout = LAYOUT,
                             .firmware = FIRMWARE_VERSION, .reset_cause = reset_cause};
  send_message(&version, sizeof version);
}

static void take_command(const wheel_command_t *command) {
  command_seq = command->seq;
  wanted_tool = command->tool;
  set_speeds(command->speed_countps);
}

static uint8_t size_of(uint8_t type) {
  switch (type) {
    case TYPE_WHEEL_COMMAND: return sizeof(wheel_command_t);
    case TYPE_CLEAR_LATCH: return sizeof(clear_latch_t);
    case TYPE_ASK_VERSION: return sizeof(ask_version_t);
    case TYPE_BOARD_CONFIG: return sizeof(board_config_t);
    default: return 0;
  }
}

static void handle(const uint8_t *message, uint8_t size) {
  uint8_t type = message[0], expected = size_of(type);
  if (!expected) answer(message, ACK_RESULT_UNKNOWN_TYPE);
  else if (size != expected) answer(message, ACK_RESULT_BAD_LENGTH);
  else if (type == TYPE_WHEEL_COMMAND) take_command((const wheel_command_t *)message);
  else if (type == TYPE_CLEAR_LATCH)
    answer(message, clear_latch(((const clear_latch_t *)message)->key));
  else if (type == TYPE_ASK_VERSION) tell_version();
  else
    answer(message, configure_wheels((const board_config_t *)message) ? ACK_RESULT_DONE
                                                                      : ACK_RESULT_BAD_VALUE);
}

static void run_tool(void) {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { set_tool(may_work() ? wanted_tool : 0); }
}

static void run_tick(void) {
  static board_state_t state = {.type = TYPE_BOARD_STATE};
  static board_imu_t imu = {.type = TYPE_BOARD_IMU};
  static uint8_t known_errors;
  state.t_us = now_us();
  state.flags = reset_cause & _BV(WDRF) ? BOARD_FLAG_WATCHDOG_RESET : 0;
  watch_power(get_config());
  run_wheels(&state);
  run_tool();
  imu.t_us = now_us();
  uint16_t imu_flags = read_imu(&imu);
  tell_safety(&state);
  state.encoder_errors = count_encoder_errors();
  if (state.encoder_errors != known_errors) state.flags |= BOARD_FLAG_ENCODER_FAULT;
  known_errors = state.encoder_errors;
  state.flags |= imu_flags;
  state.tool = get_tool();
  state.command_seq = command_seq;
  state.bad_frames = count_bad_frames();
  send_message(&state, sizeof state);
  if (!(imu_flags & BOARD_FLAG_IMU_FAULT)) {
    imu.flags = state.flags;
    send_message(&imu, sizeof imu);
  }
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    if (may_work()) LAMP_PORT |= _BV(LAMP_BIT);
    else LAMP_PORT &= ~_BV(LAMP_BIT);
  }
}

/* Sleep until the next interrupt, unless it is time. Looked at with interrupts off: the one that
 * comes in between then wakes, as `sei` lets one more instruction pass. */
static void rest_until(uint32_t next_ms) {
  set_sleep_mode(SLEEP_MODE_IDLE);
  cli();
  if ((int32_t)(now_ms() - next_ms) < 0) {
    sleep_enable();
    sei();
    sleep_cpu();
    sleep_disable();
  }
  sei();
}

int main(void) {
  reset_cause = find_reset_cause(WATCHDOG_MS);
  wdt_disable();
  begin_outputs();
  begin_encoders();
  begin_safety();
  begin_line();
  begin_i2c();
  begin_clock();
  sei();
  wdt_enable(WDTO_120MS);
  for (uint32_t next_ms = TICK_MS;;) {
    uint8_t *message, size;
    wdt_reset();
    end_silence();
    while ((size = receive_message(&message))) handle(message, size);
    uint32_t now = now_ms();
    if ((int32_t)(now - next_ms) < 0) {
      rest_until(next_ms);
      continue;
    }
    next_ms += TICK_MS;
    if ((int32_t)(now - next_ms) > TICK_MS) next_ms = now + TICK_MS; /* late: not twice in a row */
    run_tick();
  }
}
