// The IMU board: an MPU-9250 on the I2C pins of an Arduino Mega 2560, over USB at 57600 baud.
//
// It speaks as it is spoken to. Alone it prints the lines of the original's Arduino, ten a second:
//   A<ax>B<ay>C<az>D<gx>E<gy>F<gz>G, raw counts at 2 g and 250 degrees a second;
// to a rosserial host it publishes the same text on the topic `imu`, and to a host that asks for its
// version it sends the frames of the motor board, a hundred a second, with the magnetometer.
#include <Arduino.h>
#include <Wire.h>
#include <avr/wdt.h>

#include "../frames.h"
#include "../hang.h"
#include "../mpu9250.h"
#include "rosserial.h"

static const uint16_t WATCHDOG_MS = 1000;
static const uint32_t LINE_BAUD = 57600;
static const uint16_t TEXT_PERIOD_MS = 100, FRAME_PERIOD_MS = 1000 / TELEMETRY_HZ;
static const uint8_t MAG_EVERY = 5, RETRY_EVERY = 32;

enum Speech { LINES, ROSSERIAL, FRAMES };
static Speech speech = LINES;
static bool is_awake, has_mag;
static uint8_t adjustment[3], next_seq, reset_cause;
static uint32_t next_ms;
volatile hang_t hang NOT_CLEARED;
static receiver_t receiver;
static board_imu_t imu;

static bool write_register(uint8_t device, uint8_t reg, uint8_t value) {
  Wire.beginTransmission(device);
  Wire.write(reg);
  Wire.write(value);
  return Wire.endTransmission() == 0;
}

static bool read_registers(uint8_t device, uint8_t reg, uint8_t *bytes, uint8_t count) {
  Wire.beginTransmission(device);
  Wire.write(reg);
  if (Wire.endTransmission(false) != 0 || Wire.requestFrom(device, count) != count) return false;
  while (count--) *bytes++ = Wire.read();
  return true;
}

// The chip changes its mode from power-down only, and takes 100 us for it.
static bool set_mag_mode(uint8_t mode) {
  if (!write_register(MAG_ADDRESS, MAG_CONTROL, MAG_POWER_DOWN)) return false;
  delayMicroseconds(100);
  bool is_set = write_register(MAG_ADDRESS, MAG_CONTROL, mode);
  delayMicroseconds(100);
  return is_set;
}

// The original left the ranges as they are after power-up; frames have those of the protocol.
static bool wake() {
  bool is_wide = speech == FRAMES;
  is_awake = write_register(MPU_ADDRESS, MPU_POWER, MPU_BEST_CLOCK) &&
             write_register(MPU_ADDRESS, MPU_CONFIG, MPU_LOW_PASS_41_HZ) &&
             write_register(MPU_ADDRESS, MPU_GYRO_CONFIG, is_wide ? MPU_500_DPS : 0) &&
             write_register(MPU_ADDRESS, MPU_ACCEL_CONFIG, is_wide ? MPU_4_G : 0) &&
             write_register(MPU_ADDRESS, MPU_BYPASS, MPU_BYPASS_ON);
  has_mag = is_awake && set_mag_mode(MAG_FUSE_ROM) &&
            read_registers(MAG_ADDRESS, MAG_ADJUSTMENT, adjustment, 3) &&
            set_mag_mode(MAG_16_BIT_100_HZ);
  return is_awake;
}

// A chip that lost its power for a moment answers, asleep and with other ranges.
static bool is_set_up() {
  uint8_t set[3];
  bool is_wide = speech == FRAMES;
  return read_registers(MPU_ADDRESS, MPU_CONFIG, set, 3) && set[0] == MPU_LOW_PASS_41_HZ &&
         set[1] == (is_wide ? MPU_500_DPS : 0) && set[2] == (is_wide ? MPU_4_G : 0);
}

static void send_message(void *message, uint8_t size) {
  uint8_t frame[LONGEST_BODY + 4];
  ((uint8_t *)message)[1] = next_seq++;
  uint8_t count = write_frame((const uint8_t *)message, size, frame);
  if (Serial.availableForWrite() >= count) Serial.write(frame, count);
}

static void tell_version() {
  board_version_t version = {TYPE_BOARD_VERSION, 0, PROTOCOL, BOARD_KIND_IMU, LAYOUT,
                             FIRMWARE_VERSION, reset_cause};
  send_message(&version, sizeof version);
}

static void hear(uint8_t byte) {
  if (is_request(byte)) {
    if (speech == FRAMES) is_awake = false;
    speech = ROSSERIAL;
    tell_topic();
  }
  uint8_t size = take_byte(&receiver, byte);
  if (size == sizeof(ask_version_t) && receiver.body[0] == TYPE_ASK_VERSION) {
    if (speech != FRAMES) {
      speech = FRAMES;
      wake();
    }
    tell_version();
  }
}

static void say_text(const uint8_t *bytes) {
  static const uint8_t places[6] = {0, 2, 4, 8, 10, 12};
  char text[50];
  char *end = text;
  for (uint8_t i = 0; i < 6; i++)
    end += sprintf(end, "%c%d", 'A' + i, read_big_endian(bytes + places[i]));
  strcpy(end, "G");
  if (speech == ROSSERIAL) publish(text);
#ifndef PRINTS_ALWAYS
  else
#endif
    Serial.println(text);
}

static void say_frame(const uint8_t *bytes, uint8_t tick) {
  read_mpu_bytes(bytes, &imu);
  if (has_mag && tick % MAG_EVERY == 0) {
    uint8_t field[MAG_READING_BYTES];
    has_mag = read_registers(MAG_ADDRESS, MAG_STATUS, field, MAG_READING_BYTES);
    if (has_mag) read_mag_bytes(field, adjustment, &imu);
  }
  imu.type = TYPE_BOARD_IMU;
  imu.flags = (has_mag ? 0 : BOARD_FLAG_MAG_FAULT) |
              (reset_cause & _BV(WDRF) ? BOARD_FLAG_WATCHDOG_RESET : 0);
  send_message(&imu, sizeof imu);
}

// Arduino's clock overflows every 1.024 ms; this is half a turn later.
ISR(TIMER0_COMPA_vect) { count_silence(); }

void setup() {
  reset_cause = find_reset_cause(WATCHDOG_MS);
  OCR0A = 128;
  TIMSK0 |= _BV(OCIE0A);
  wdt_enable(WDTO_1S);
  Serial.begin(LINE_BAUD);
  Wire.begin();
  Wire.setClock(400000);
  Wire.setWireTimeout(3000, true);
  wake();
}

void loop() {
  static uint8_t tick;
  wdt_reset();
  end_silence();
  while (Serial.available()) hear(Serial.read());
  uint16_t period_ms = speech == FRAMES ? FRAME_PERIOD_MS : TEXT_PERIOD_MS;
  if ((int32_t)(millis() - next_ms) < 0) return;
  next_ms += period_ms;
  if ((int32_t)(millis() - next_ms) > 0) next_ms = millis() + period_ms;
  tick++;
  bool is_time = speech != FRAMES || tick % RETRY_EVERY == 0;
  if (is_time && is_awake && !is_set_up()) is_awake = false;
  if (is_time && !(is_awake && (has_mag || speech != FRAMES))) wake();
  uint8_t bytes[MPU_READING_BYTES];
  imu.t_us = micros();
  if (is_awake) is_awake = read_registers(MPU_ADDRESS, MPU_READINGS, bytes, MPU_READING_BYTES);
  if (!is_awake) return; // silence, not old numbers
  if (speech == FRAMES) say_frame(bytes, tick);
  else say_text(bytes);
}
