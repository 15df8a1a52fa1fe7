#include "line.h"

#include <avr/interrupt.h>
#include <avr/io.h>

#include "../frames.h"

#define IN_SIZE 128 /* powers of two */
#define OUT_SIZE 256

static volatile uint8_t in[IN_SIZE], in_head, in_tail;
static uint8_t out[OUT_SIZE];
static volatile uint8_t out_head, out_tail;
static uint8_t next_seq;
static receiver_t receiver;

ISR(USART0_RX_vect) {
  uint8_t byte = UDR0, next = (in_head + 1) & (IN_SIZE - 1);
  if (next == in_tail) return; /* the CRC finds the loss */
  in[in_head] = byte;
  in_head = next;
}

ISR(USART0_UDRE_vect) {
  if (out_head == out_tail) UCSR0B &= ~_BV(UDRIE0);
  else UDR0 = out[out_tail++];
}

void begin_line(void) {
  UCSR0A = _BV(U2X0);
  UBRR0 = F_CPU / 8 / BAUD - 1;
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

void send_message(void *message, uint8_t size) {
  static uint8_t frame[LONGEST_BODY + 4];
  ((uint8_t *)message)[1] = next_seq++;
  uint8_t count = write_frame(message, size, frame);
  if ((uint8_t)(out_tail - out_head - 1) < count) return;
  uint8_t head = out_head;
  for (uint8_t i = 0; i < count; i++) out[head++] = frame[i];
  out_head = head;
  UCSR0B |= _BV(UDRIE0);
}

uint8_t receive_message(uint8_t **message) {
  while (in_tail != in_head) {
    uint8_t byte = in[in_tail];
    in_tail = (in_tail + 1) & (IN_SIZE - 1);
    uint8_t size = take_byte(&receiver, byte);
    if (size) {
      *message = receiver.body;
      return size;
    }
  }
  return 0;
}

uint8_t count_bad_frames(void) { return receiver.bad; }
