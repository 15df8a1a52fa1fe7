/* The serial line to the robot's computer: frames in and out, without ever waiting for it. */
#ifndef LINE_H
#define LINE_H

#include <stdint.h>

void begin_line(void);

/* Send a message of `size` bytes that begins with type and sequence number; the number is given
 * here. Where the line has no room it is dropped, and the host sees the gap in the numbers. */
void send_message(void *message, uint8_t size);

/* Look for the next whole message. Returns its size, 0 without one. */
uint8_t receive_message(uint8_t **message);

/* How many frames were broken, modulo 256. */
uint8_t count_bad_frames(void);

#endif
