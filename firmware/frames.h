/* Frames between host and board: COBS, CRC-16/XMODEM, a zero at the end.
 * Used by the motor board (C) and by the IMU board (C++); how bytes are sent is theirs.
 */
#ifndef FRAMES_H
#define FRAMES_H

#include <stdint.h>
#include <util/crc16.h>

#include "wire.h"

#define LONGEST_BODY 80 /* type, seq, fields and CRC of the longest message of the table */
#define FIRMWARE_VERSION {1, 1, 1}

static inline uint16_t compute_crc(const uint8_t *bytes, uint8_t count) {
  uint16_t crc = 0;
  while (count--) crc = _crc_xmodem_update(crc, *bytes++);
  return crc;
}

/* Write the frame of a message of `size` bytes; `out` needs size + 4. Returns how long it is. */
static inline uint8_t write_frame(const uint8_t *message, uint8_t size, uint8_t *out) {
  uint16_t crc = compute_crc(message, size);
  uint8_t code_at = 0, at = 1, code = 1;
  for (uint8_t i = 0; i < size + 2; i++) {
    uint8_t byte = i < size ? message[i] : i == size ? (uint8_t)crc : (uint8_t)(crc >> 8);
    if (byte) {
      out[at++] = byte;
      code++;
    } else {
      out[code_at] = code;
      code_at = at++;
      code = 1;
    }
  }
  out[code_at] = code;
  out[at++] = 0;
  return at;
}

/* The received part of a frame, unstuffed byte by byte. */
typedef struct {
  uint8_t body[LONGEST_BODY];
  uint8_t size, left, code, is_broken, bad;
} receiver_t;

/* Take a byte. Returns the size of the message in `body` that it completes, without the CRC, or 0. */
static inline uint8_t take_byte(receiver_t *rx, uint8_t byte) {
  if (byte == 0) {
    uint8_t size = rx->size, is_frame = size >= 4 && !rx->is_broken && rx->left == 0;
    uint8_t is_silence = size == 0 && !rx->is_broken && rx->code == 0;
    if (is_frame) {
      uint16_t crc = compute_crc(rx->body, size - 2);
      is_frame = rx->body[size - 2] == (uint8_t)crc && rx->body[size - 1] == (uint8_t)(crc >> 8);
    }
    if (!is_frame && !is_silence) rx->bad++;
    rx->size = rx->left = rx->code = rx->is_broken = 0;
    return is_frame ? size - 2 : 0;
  }
  if (rx->left == 0) { /* a code: the zero that it stands for comes before what follows */
    if (rx->code && rx->code < 255) {
      if (rx->size < LONGEST_BODY) rx->body[rx->size++] = 0;
      else rx->is_broken = 1;
    }
    rx->code = byte;
    rx->left = byte - 1;
  } else {
    if (rx->size < LONGEST_BODY) rx->body[rx->size++] = byte;
    else rx->is_broken = 1;
    rx->left--;
  }
  return 0;
}

#endif
