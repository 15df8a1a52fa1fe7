#include "imu.h"

#include <util/delay.h>

#include "../mpu9250.h"
#include "i2c.h"

#define MAG_EVERY 5    /* ticks: 20 Hz */
#define RETRY_EVERY 32 /* ticks */

static uint8_t adjustment[3], is_awake, has_mag, tick = RETRY_EVERY - 1;

/* The chip changes its mode from power-down only, and takes 100 us for it. */
static uint8_t set_mag_mode(uint8_t mode) {
  if (!write_register(MAG_ADDRESS, MAG_CONTROL, MAG_POWER_DOWN)) return 0;
  _delay_us(100);
  uint8_t is_set = write_register(MAG_ADDRESS, MAG_CONTROL, mode);
  _delay_us(100);
  return is_set;
}

static uint8_t wake_mag(void) {
  return set_mag_mode(MAG_FUSE_ROM) &&
         read_registers(MAG_ADDRESS, MAG_ADJUSTMENT, adjustment, 3) &&
         set_mag_mode(MAG_16_BIT_100_HZ);
}

static uint8_t wake_mpu(void) {
  return write_register(MPU_ADDRESS, MPU_POWER, MPU_BEST_CLOCK) &&
         write_register(MPU_ADDRESS, MPU_CONFIG, MPU_LOW_PASS_41_HZ) &&
         write_register(MPU_ADDRESS, MPU_GYRO_CONFIG, MPU_500_DPS) &&
         write_register(MPU_ADDRESS, MPU_ACCEL_CONFIG, MPU_4_G) &&
         write_register(MPU_ADDRESS, MPU_BYPASS, MPU_BYPASS_ON);
}

/* A chip that lost its power for a moment answers, asleep and with other ranges. */
static uint8_t is_set_up(void) {
  uint8_t set[3];
  return read_registers(MPU_ADDRESS, MPU_CONFIG, set, 3) && set[0] == MPU_LOW_PASS_41_HZ &&
         set[1] == MPU_500_DPS && set[2] == MPU_4_G;
}

uint16_t read_imu(board_imu_t *imu) {
  uint8_t bytes[MPU_READING_BYTES];
  tick++;
  if (is_awake && tick % RETRY_EVERY == RETRY_EVERY / 2) is_awake = is_set_up();
  if (tick % RETRY_EVERY == 0 && !(is_awake && has_mag)) {
    free_i2c();
    if (!is_awake) is_awake = wake_mpu();
    if (is_awake) has_mag = wake_mag();
  }
  if (is_awake) is_awake = read_registers(MPU_ADDRESS, MPU_READINGS, bytes, MPU_READING_BYTES);
  if (!is_awake) {
    has_mag = 0;
    return BOARD_FLAG_IMU_FAULT | BOARD_FLAG_MAG_FAULT;
  }
  read_mpu_bytes(bytes, imu);
  if (has_mag && tick % MAG_EVERY == 0) {
    has_mag = read_registers(MAG_ADDRESS, MAG_STATUS, bytes, MAG_READING_BYTES);
    if (has_mag) read_mag_bytes(bytes, adjustment, imu);
  }
  return has_mag ? 0 : BOARD_FLAG_MAG_FAULT;
}
