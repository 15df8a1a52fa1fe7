/* The side of a device in rosserial, as the original's Arduino was: one topic of std_msgs/String.
 * Source: wiki.ros.org/rosserial/Overview/Protocol (version 2 of it, of ROS Hydro and later).
 */
#ifndef ROSSERIAL_H
#define ROSSERIAL_H

#include <Arduino.h>

static const uint16_t TOPIC_PUBLISHER = 0, TOPIC_IMU = 101;
static const uint8_t REQUEST_TOPICS[] = {0xFF, 0xFE, 0, 0, 0xFF, 0, 0, 0xFF};

static uint8_t sum_of;

static void send_summed(uint8_t byte) {
  sum_of += byte;
  Serial.write(byte);
}

static void send_u16(uint16_t value) {
  send_summed(value);
  send_summed(value >> 8);
}

static void send_u32(uint32_t value) {
  send_u16(value);
  send_u16(value >> 16);
}

static void send_text(const char *text) {
  send_u32(strlen(text));
  while (*text) send_summed(*text++);
}

static void begin_packet(uint16_t topic, uint16_t size) {
  Serial.write(0xFF);
  Serial.write(0xFE);
  sum_of = 0;
  send_u16(size);
  Serial.write(255 - sum_of);
  sum_of = 0;
  send_u16(topic);
}

static void end_packet() { Serial.write(255 - sum_of); }

/* Say which topic will come, as the host has asked. */
static void tell_topic() {
  const char *words[] = {"imu", "std_msgs/String", "992ce8a1687cec8c8bd883ec73ca41d1"};
  uint16_t size = 6;
  for (const char *word : words) size += 4 + strlen(word);
  begin_packet(TOPIC_PUBLISHER, size);
  send_u16(TOPIC_IMU);
  for (const char *word : words) send_text(word);
  send_u32(512);
  end_packet();
}

static void publish(const char *text) {
  begin_packet(TOPIC_IMU, 4 + strlen(text));
  send_text(text);
  end_packet();
}

/* Whether this byte ends a request for the topics. */
static bool is_request(uint8_t byte) {
  static uint8_t matched;
  matched = byte == REQUEST_TOPICS[matched] ? matched + 1 : byte == REQUEST_TOPICS[0];
  if (matched < sizeof REQUEST_TOPICS) return false;
  matched = 0;
  return true;
}

#endif
