/* Written by scripts/generate_board_wire.py from
 * src/agribot/drivers/board/board_protocol.py: change that one. Little-endian, as the AVR is.
 */
#ifndef WIRE_H
#define WIRE_H

#include <stdint.h>

#ifdef __cplusplus
#define SIZE_IS(type, size) static_assert(sizeof(type) == size, #type)
#else
#define SIZE_IS(type, size) _Static_assert(sizeof(type) == size, #type)
#endif

#define PROTOCOL 1
#define LAYOUT 0x153Du
#define BAUD 250000ul
#define TELEMETRY_HZ 100
#define COMMAND_TIMEOUT_MS 300
#define CLEAR_KEY 0x5AFEu

/* BoardFlag: State of a board */
#define BOARD_FLAG_ESTOP_PRESSED 1u
#define BOARD_FLAG_BUMPER_PRESSED 2u
#define BOARD_FLAG_STOP_LATCHED 4u
#define BOARD_FLAG_NO_COMMAND 8u
#define BOARD_FLAG_NOT_CONFIGURED 16u
#define BOARD_FLAG_WAITS_FOR_ZERO 32u
#define BOARD_FLAG_BATTERY_LOW 64u
#define BOARD_FLAG_MOTOR_FAULT 128u
#define BOARD_FLAG_ENCODER_FAULT 256u
#define BOARD_FLAG_IMU_FAULT 512u
#define BOARD_FLAG_MAG_FAULT 1024u
#define BOARD_FLAG_WATCHDOG_RESET 2048u

/* StopCause: Causes of the latched stop, all since it was cleared */
#define STOP_CAUSE_BEGAN 1u
#define STOP_CAUSE_ESTOP 2u
#define STOP_CAUSE_BUMPER 4u
#define STOP_CAUSE_BATTERY 8u
#define STOP_CAUSE_MOTOR 16u
#define STOP_CAUSE_REVERSED 32u

/* AckResult: Result of a message that is answered */
#define ACK_RESULT_DONE 0u
#define ACK_RESULT_BAD_LENGTH 1u
#define ACK_RESULT_BAD_VALUE 2u
#define ACK_RESULT_UNKNOWN_TYPE 3u
#define ACK_RESULT_STILL_PRESSED 4u
#define ACK_RESULT_STILL_LOW 5u

/* BoardKind: Kind of a board */
#define BOARD_KIND_MOTOR 1u
#define BOARD_KIND_IMU 2u

/* Turn the wheels so fast, and switch these outputs of the tool; echoed in BoardState */
#define TYPE_WHEEL_COMMAND 0x10
typedef struct __attribute__((packed)) {
  uint8_t type;
  uint8_t seq;
  int16_t speed_countps[4]; /* count/s */
  uint8_t tool; /* bits */
} wheel_command_t;
SIZE_IS(wheel_command_t, 11);

/* End a latched stop, as a person wants it; answered */
#define TYPE_CLEAR_LATCH 0x11
typedef struct __attribute__((packed)) {
  uint8_t type;
  uint8_t seq;
  uint16_t key;
} clear_latch_t;
SIZE_IS(clear_latch_t, 4);

/* Ask for BoardVersion; an IMU board speaks frames from then on instead of lines */
#define TYPE_ASK_VERSION 0x12
typedef struct __attribute__((packed)) {
  uint8_t type;
  uint8_t seq;
} ask_version_t;
SIZE_IS(ask_version_t, 2);

/* Settings of this robot's motor board; answered. Without them the wheels do not turn */
#define TYPE_BOARD_CONFIG 0x13
typedef struct __attribute__((packed)) {
  uint8_t type;
  uint8_t seq;
  uint16_t full_speed_countps; /* count/s */
  uint16_t max_speed_countps; /* count/s */
  uint16_t max_accel_countps2; /* count/s² / 10 */
  uint16_t kp_ratio; /* 1 / 0.00390625 */
  uint16_t ti_s; /* s / 0.001 */
  uint16_t current_limit_a; /* A / 0.001 */
  uint16_t battery_cutoff_v; /* V / 0.001 */
  uint8_t motor_flips; /* bits */
  uint8_t encoder_flips; /* bits */
} board_config_t;
SIZE_IS(board_config_t, 18);

/* Wheels and inputs of the motor board, a hundred times a second */
#define TYPE_BOARD_STATE 0x81
typedef struct __attribute__((packed)) {
  uint8_t type;
  uint8_t seq;
  uint32_t t_us; /* µs */
  int32_t counts[4]; /* count */
  int16_t speed_countps[4]; /* count/s */
  int8_t duty_ratio[4]; /* 1 / 0.01 */
  uint16_t current_a[4]; /* A / 0.001 */
  uint16_t battery_v; /* V / 0.001 */
  uint16_t flags; /* BoardFlag */
  uint8_t stop_causes; /* StopCause */
  uint8_t motor_faults; /* bits */
  uint8_t tool; /* bits */
  uint8_t command_seq;
  uint8_t bad_frames; /* modulo 256 */
  uint8_t encoder_errors; /* modulo 256 */
} board_state_t;
SIZE_IS(board_state_t, 52);

/* Version of the board; `layout` is that of its table, and must be LAYOUT */
#define TYPE_BOARD_VERSION 0x82
typedef struct __attribute__((packed)) {
  uint8_t type;
  uint8_t seq;
  uint8_t protocol;
  uint8_t board; /* BoardKind */
  uint16_t layout;
  uint8_t firmware[3];
  uint8_t reset_cause; /* MCUSR */
} board_version_t;
SIZE_IS(board_version_t, 10);

/* Inertial and magnetic readings in the axes of the MPU's chip, a hundred times a second */
#define TYPE_BOARD_IMU 0x83
typedef struct __attribute__((packed)) {
  uint8_t type;
  uint8_t seq;
  uint32_t t_us; /* µs */
  int16_t accel_mps2[3]; /* m/s² / 0.0011971 */
  int16_t temperature_c; /* °C / 0.01 */
  int16_t gyro_radps[3]; /* rad/s / 0.000266316 */
  int16_t mag_t[3]; /* T / 1.5e-07 */
  uint8_t mag_count; /* modulo 256 */
  uint16_t flags; /* BoardFlag */
} board_imu_t;
SIZE_IS(board_imu_t, 29);

/* Result of the message of this type and sequence number */
#define TYPE_BOARD_ACK 0x84
typedef struct __attribute__((packed)) {
  uint8_t type;
  uint8_t seq;
  uint8_t of_type;
  uint8_t of_seq;
  uint8_t result; /* AckResult */
} board_ack_t;
SIZE_IS(board_ack_t, 5);

#endif
