/* The MPU-9250 on the I2C bus. */
#ifndef IMU_H
#define IMU_H

#include <stdint.h>

#include "../wire.h"

/* Read what is new into `imu`, or try to wake the chip up. Returns BOARD_FLAG_IMU_FAULT and
 * BOARD_FLAG_MAG_FAULT as they are. */
uint16_t read_imu(board_imu_t *imu);

#endif
