/* Registers of the MPU-9250 (and 9255, 9265) and of the AK8963 inside it, and what its bytes mean.
 * Source: InvenSense RM-MPU-9250A-00 and PS-MPU-9250A-01; AKM MS1356-E-02.
 */
#ifndef MPU9250_H
#define MPU9250_H

#include <stdint.h>

#include "wire.h"

#define MPU_ADDRESS 0x68
#define MPU_CONFIG 0x1A
#define MPU_GYRO_CONFIG 0x1B
#define MPU_ACCEL_CONFIG 0x1C
#define MPU_BYPASS 0x37
#define MPU_READINGS 0x3B /* accelerometer, temperature, gyro: seven big-endian int16 */
#define MPU_POWER 0x6B
#define MPU_READING_BYTES 14

#define MPU_LOW_PASS_41_HZ 3
#define MPU_500_DPS 0x08
#define MPU_4_G 0x08
#define MPU_BYPASS_ON 0x02
#define MPU_BEST_CLOCK 0x01

#define MAG_ADDRESS 0x0C
#define MAG_STATUS 0x02 /* status 1, three little-endian int16, status 2 */
#define MAG_READING_BYTES 8
#define MAG_CONTROL 0x0A
#define MAG_ADJUSTMENT 0x10
#define MAG_FUSE_ROM 0x0F
#define MAG_POWER_DOWN 0x00
#define MAG_16_BIT_100_HZ 0x16
#define MAG_IS_READY 0x01
#define MAG_OVERFLOW 0x08

static inline int16_t read_big_endian(const uint8_t *bytes) {
  return (int16_t)((uint16_t)bytes[0] << 8 | bytes[1]);
}

static inline void read_mpu_bytes(const uint8_t *bytes, board_imu_t *imu) {
  for (uint8_t i = 0; i < 3; i++) {
    imu->accel_mps2[i] = read_big_endian(bytes + 2 * i);
    imu->gyro_radps[i] = read_big_endian(bytes + 8 + 2 * i);
  }
  /* 333.87 per degree, zero at 21 degrees; 9815 / 32768 = 100 / 333.87. */
  imu->temperature_c = (int16_t)((int32_t)read_big_endian(bytes + 6) * 9815 / 32768 + 2100);
}

/* The magnetometer's x and y are the MPU's y and x, and its z points down; `adjustment` is that of
 * its fuse ROM. Bytes that are old or out of range are left out. */
static inline void read_mag_bytes(const uint8_t *bytes, const uint8_t *adjustment,
                                  board_imu_t *imu) {
  if (!(bytes[0] & MAG_IS_READY) || (bytes[7] & MAG_OVERFLOW)) return;
  int16_t field[3];
  for (uint8_t i = 0; i < 3; i++) {
    int32_t raw = (int16_t)((uint16_t)bytes[2 + 2 * i] << 8 | bytes[1 + 2 * i]);
    field[i] = (int16_t)(raw * ((int16_t)adjustment[i] + 128) / 256);
  }
  imu->mag_t[0] = field[1];
  imu->mag_t[1] = field[0];
  imu->mag_t[2] = -field[2];
  imu->mag_count++;
}

#endif
