/* An ATmega2560 on the bench: libsimavr runs the firmware, instruction by instruction, with
 * what is wired to the board around it: MPU-9250 and AK8963, encoders, contacts, voltages, a serial
 * line. Driven by avr_bench.py through ctypes. For tests only: simavr is under the GPL, and nothing
 * of this goes into a package.
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_twi.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_cycle_timers.h>
#include <simavr/sim_hex.h>
#include <simavr/sim_irq.h>

#define HZ 16000000
#define STANDING_COUNTPS 1e-3 /* slower, the next edge is further off than timers count */
#define WHEELS 4
#define LINE_SIZE 65536 /* powers of two */
#define MPU 0
#define MAG 1
#define BYPASS 0x37
#define MCUSR 0x54 /* in the data memory, with what has reset the chip */
#define POWER_ON 1
#define RESET_PIN 2
#define SCL 1 /* of port D */
#define SDA 2

typedef struct {
  uint8_t address, is_there, is_chosen, has_pointer, pointer, registers[128];
} chip_t;

typedef struct bench bench_t;

typedef struct {
  bench_t *bench;
  int wheel;
  double position, speed_countps; /* of the disc; its whole numbers are edges */
  avr_cycle_count_t at;           /* the cycle of that position */
  int64_t count;
} encoder_t;

struct bench {
  avr_t *avr;
  avr_irq_t *twi;
  chip_t chips[2];
  encoder_t encoders[WHEELS];
  uint8_t from_board[LINE_SIZE], to_board[LINE_SIZE];
  uint32_t from_head, from_tail, to_head, to_tail;
  int may_send;
  uint32_t resets, saved_at;
  uint8_t saved[2];
  int is_hung;
  uint8_t is_high[2][8]; /* what pulls at ports B and L */
  int sda_clocks;        /* until a chip that holds the data line low lets go of it */
  uint8_t directions;    /* of port D */
};

/* ---- the I2C bus ---- */

static int is_on_bus(const bench_t *bench, int which) {
  int is_bypassed = bench->chips[MPU].registers[BYPASS] & 2;
  return bench->chips[which].is_there && (which == MPU || (bench->chips[MPU].is_there && is_bypassed));
}

static void answer(bench_t *bench, uint32_t what, uint8_t address, uint8_t data) {
  avr_raise_irq(bench->twi + TWI_IRQ_INPUT, avr_twi_irq_msg(what, address, data));
}

static void on_twi(struct avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  bench_t *bench = param;
  if (bench->sda_clocks) return; /* neither a start nor an answer gets through */
  avr_twi_msg_irq_t message = {.u.v = value};
  uint8_t what = message.u.twi.msg;
  for (int which = 0; which < 2; which++) {
    chip_t *chip = &bench->chips[which];
    if (what & (TWI_COND_STOP | TWI_COND_START)) chip->is_chosen = chip->has_pointer = 0;
    if ((what & TWI_COND_START) && is_on_bus(bench, which) &&
        message.u.twi.addr >> 1 == chip->address) {
      chip->is_chosen = 1;
      answer(bench, TWI_COND_ACK, message.u.twi.addr, 1);
    }
    if (!chip->is_chosen || !is_on_bus(bench, which)) continue;
    if (what & TWI_COND_WRITE) {
      answer(bench, TWI_COND_ACK, chip->address << 1, 1);
      if (chip->has_pointer) chip->registers[chip->pointer++ & 127] = message.u.twi.data;
      else chip->pointer = message.u.twi.data;
      chip->has_pointer = 1;
    }
    if (what & TWI_COND_READ)
      answer(bench, TWI_COND_READ, chip->address << 1, chip->registers[chip->pointer++ & 127]);
  }
}

/* What the chips hold when they get their power. */
static void power_up(bench_t *bench) {
  chip_t *mpu = &bench->chips[MPU], *mag = &bench->chips[MAG];
  memset(mpu->registers, 0, sizeof mpu->registers);
  memset(mag->registers, 0, sizeof mag->registers);
  mpu->address = 0x68;
  mpu->registers[0x75] = 0x71;
  mpu->registers[0x6B] = 0x01;
  mag->address = 0x0C;
  mag->registers[0x00] = 0x48;
  memset(mag->registers + 0x10, 128, 3);
}

/* ---- the serial line ---- */

static void on_uart(struct avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  bench_t *bench = param;
  bench->from_board[bench->from_head++ & (LINE_SIZE - 1)] = value;
}

static void feed_uart(bench_t *bench) {
  avr_irq_t *in = avr_io_getirq(bench->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
  while (bench->may_send && bench->to_tail != bench->to_head)
    avr_raise_irq(in, bench->to_board[bench->to_tail++ & (LINE_SIZE - 1)]);
}

static void on_xon(struct avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq, (void)value;
  ((bench_t *)param)->may_send = 1;
  feed_uart(param);
}

static void on_xoff(struct avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq, (void)value;
  ((bench_t *)param)->may_send = 0;
}

/* ---- pins ---- */

static avr_irq_t *find_pin(bench_t *bench, char port, int bit) {
  return avr_io_getirq(bench->avr, AVR_IOCTL_IOPORT_GETIRQ(port), bit);
}

/* The resistors of the I2C bus pull both its lines up, unless a chip holds one. */
static void pull_bus(bench_t *bench) {
  avr_ioport_external_t outside = {
      .name = 'D', .mask = SCL | SDA, .value = bench->sda_clocks ? SCL : SCL | SDA};
  avr_ioctl(bench->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('D'), &outside);
  for (int bit = 0; bit < 2; bit++) {
    avr_raise_irq(find_pin(bench, 'D', bit), !(outside.value >> bit & 1));
    avr_raise_irq(find_pin(bench, 'D', bit), outside.value >> bit & 1);
  }
}

/* A program that makes the clock's pin an output pulls the line low, as the port's bit is zero. */
static void on_directions(struct avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  bench_t *bench = param;
  int rises = (bench->directions & SCL) && !(value & SCL);
  bench->directions = value;
  if (rises && bench->sda_clocks && !--bench->sda_clocks) pull_bus(bench);
}

/* A chip that was cut off in the middle of a byte holds the data line low, until the clock has
 * gone up so often. */
void bench_hold_sda(bench_t *bench, int clocks) {
  bench->sda_clocks = clocks;
  pull_bus(bench);
}

/* Pull at a pin of port B or L. */
void bench_set_pin(bench_t *bench, char port, int bit, int is_high) {
  uint8_t *level = &bench->is_high[port == 'L'][bit];
  if (*level == is_high) return;
  *level = is_high;
  avr_raise_irq(find_pin(bench, port, bit), is_high);
}

/* Where the program writes to a port, what pulls from outside is stronger than its pull-ups. */
static void hold_pins(bench_t *bench) {
  for (int port = 0; port < 2; port++) {
    avr_ioport_external_t outside = {.name = "BL"[port], .mask = 0xFF, .value = 0};
    for (int bit = 0; bit < 8; bit++) outside.value |= bench->is_high[port][bit] << bit;
    avr_ioctl(bench->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(outside.name), &outside);
  }
}

void bench_set_voltage(bench_t *bench, int channel, int mv) {
  avr_raise_irq(avr_io_getirq(bench->avr, AVR_IOCTL_ADC_GETIRQ, channel), mv);
}

/* ---- the encoders ---- */

static double place_at(const encoder_t *encoder, avr_cycle_count_t cycle) {
  return encoder->position + encoder->speed_countps * (double)(cycle - encoder->at) / HZ;
}

static void show_edge(const encoder_t *encoder) {
  int quarter = (int)(encoder->count & 3);
  bench_set_pin(encoder->bench, 'B', 2 * encoder->wheel, quarter == 1 || quarter == 2);
  bench_set_pin(encoder->bench, 'B', 2 * encoder->wheel + 1, quarter >= 2);
}

static avr_cycle_count_t next_edge(const encoder_t *encoder, avr_cycle_count_t now) {
  double speed = encoder->speed_countps, place = place_at(encoder, now);
  double goal = speed > 0 ? (double)encoder->count + 1.0 : (double)encoder->count;
  double way = (goal - place) / speed; /* s */
  return way > 0 ? (avr_cycle_count_t)(way * HZ) + 1 : 1;
}

static avr_cycle_count_t on_edge(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)avr;
  encoder_t *encoder = param;
  encoder->count += encoder->speed_countps > 0 ? 1 : -1;
  show_edge(encoder);
  return when + next_edge(encoder, when);
}

void bench_turn(bench_t *bench, int wheel, double speed_countps) {
  encoder_t *encoder = &bench->encoders[wheel];
  avr_t *avr = bench->avr;
  encoder->position = place_at(encoder, avr->cycle);
  encoder->at = avr->cycle;
  if (fabs(speed_countps) < STANDING_COUNTPS) speed_countps = 0.0;
  if (speed_countps == encoder->speed_countps) return;
  encoder->speed_countps = speed_countps;
  avr_cycle_timer_cancel(avr, on_edge, encoder);
  if (speed_countps != 0.0)
    avr_cycle_timer_register(avr, next_edge(encoder, avr->cycle), on_edge, encoder);
}

double bench_count(const bench_t *bench, int wheel) { return bench->encoders[wheel].count; }

/* ---- the board ---- */

static void skip_sleep(avr_t *avr, avr_cycle_count_t cycles) { (void)avr, (void)cycles; }

static avr_cycle_count_t on_end(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)avr, (void)when, (void)param;
  return 0;
}

/* Put a hex file into the flash. Returns where it begins, or -1. */
static int64_t load(avr_t *avr, const char *hex) {
  uint32_t size = 0, start = 0;
  uint8_t *code = read_ihex_file(hex, &size, &start);
  if (!code) return -1;
  avr_loadcode(avr, code, size, start);
  if (start + size > avr->codeend) avr->codeend = start + size;
  free(code);
  return start;
}

/* A bootloader may be null: then the board begins with its program. */
bench_t *bench_new(const char *hex, const char *bootloader) {
  avr_t *avr = avr_make_mcu_by_name("atmega2560");
  if (!avr) return 0;
  bench_t *bench = calloc(1, sizeof *bench);
  bench->avr = avr;
  avr_init(avr);
  avr->log = LOG_NONE;
  avr->codeend = 0;
  int64_t start = load(avr, hex);
  if (start >= 0 && bootloader) start = load(avr, bootloader);
  if (start < 0) return 0;
  avr->reset_pc = avr->pc = start;
  avr->frequency = HZ;
  avr->vcc = avr->avcc = avr->aref = 5000;
  avr->sleep = skip_sleep; /* simulated time passes, ours does not */
  for (int k = 0; k < 8; k++) /* unused, but looked at in every cycle */
    avr_extint_set_strict_lvl_trig(avr, k, 0);
  avr->data[MCUSR] = POWER_ON;
  power_up(bench);
  bench->chips[MPU].is_there = bench->chips[MAG].is_there = 1;
  static const char *names[2] = {"8>chips", "32<chips"};
  bench->twi = avr_alloc_irq(&avr->irq_pool, 0, 2, names);
  avr_irq_register_notify(bench->twi + TWI_IRQ_OUTPUT, on_twi, bench);
  avr_connect_irq(bench->twi + TWI_IRQ_INPUT,
                  avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_INPUT));
  avr_connect_irq(avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_OUTPUT),
                  bench->twi + TWI_IRQ_OUTPUT);
  uint32_t flags = 0;
  avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
  flags &= ~(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  uint32_t uart = AVR_IOCTL_UART_GETIRQ('0');
  avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUTPUT), on_uart, bench);
  avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUT_XON), on_xon, bench);
  avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUT_XOFF), on_xoff, bench);
  bench->may_send = 1;
  avr_irq_t *directions =
      avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'), IOPORT_IRQ_DIRECTION_ALL);
  avr_irq_register_notify(directions, on_directions, bench);
  pull_bus(bench);
  for (int k = 0; k < WHEELS; k++) {
    encoder_t *encoder = &bench->encoders[k];
    encoder->bench = bench;
    encoder->wheel = k;
    encoder->position = 0.5; /* between two edges */
    show_edge(encoder);
  }
  return bench;
}

void bench_free(bench_t *bench) {
  avr_terminate(bench->avr);
  free(bench);
}

void bench_set_registers(bench_t *bench, int chip, int first, const uint8_t *bytes, int count) {
  memcpy(bench->chips[chip].registers + first, bytes, count);
}

int bench_get_register(const bench_t *bench, int chip, int which) {
  return bench->chips[chip].registers[which];
}

/* Unplug the IMU, or plug it in again: it begins as a chip does that gets its power. */
void bench_plug_imu(bench_t *bench, int is_there) {
  if (is_there && !bench->chips[MPU].is_there) power_up(bench);
  bench->chips[MPU].is_there = bench->chips[MAG].is_there = is_there;
}

int bench_read_data(const bench_t *bench, int address) { return bench->avr->data[address]; }

double bench_time(const bench_t *bench) { return (double)bench->avr->cycle / HZ; }

uint32_t bench_resets(const bench_t *bench) { return bench->resets; }

int bench_receive(bench_t *bench, uint8_t *bytes, int count) {
  int taken = 0;
  while (taken < count && bench->from_tail != bench->from_head)
    bytes[taken++] = bench->from_board[bench->from_tail++ & (LINE_SIZE - 1)];
  return taken;
}

/* Put bytes on the line to the board. Returns how many it had room for. */
int bench_send(bench_t *bench, const uint8_t *bytes, int count) {
  int taken = 0;
  while (taken < count && bench->to_head - bench->to_tail < LINE_SIZE)
    bench->to_board[bench->to_head++ & (LINE_SIZE - 1)] = bytes[taken++];
  feed_uart(bench);
  return taken;
}

int bench_waiting(const bench_t *bench) { return bench->to_head - bench->to_tail; }

/* Let the program hang at its next instruction that an interrupt may come between: one that jumps
 * to itself. */
void bench_hang(bench_t *bench) {
  avr_t *avr = bench->avr;
  while (!avr->sreg[S_I] && avr->state == cpu_Running) avr_run(avr);
  bench->saved_at = avr->pc;
  memcpy(bench->saved, avr->flash + avr->pc, 2);
  avr->flash[avr->pc] = 0xFF;
  avr->flash[avr->pc + 1] = 0xCF;
  bench->is_hung = 1;
}

/* A reset makes simavr forget its timers and what pulls at its pins. */
static void after_reset(bench_t *bench) {
  avr_t *avr = bench->avr;
  bench->resets++;
  bench->may_send = 1;
  if (bench->is_hung) memcpy(avr->flash + bench->saved_at, bench->saved, 2);
  bench->is_hung = 0;
  for (int port = 0; port < 2; port++)
    for (int bit = 0; bit < 8; bit++) {
      avr_irq_t *pin = find_pin(bench, "BL"[port], bit);
      avr_raise_irq(pin, !bench->is_high[port][bit]);
      avr_raise_irq(pin, bench->is_high[port][bit]);
    }
  pull_bus(bench);
  for (int k = 0; k < WHEELS; k++) {
    encoder_t *encoder = &bench->encoders[k];
    if (encoder->speed_countps != 0.0)
      avr_cycle_timer_register(avr, next_edge(encoder, avr->cycle), on_edge, encoder);
  }
}

/* Press the reset button, as opening the serial line does. */
void bench_reset(bench_t *bench) {
  avr_reset(bench->avr);
  bench->avr->data[MCUSR] = RESET_PIN;
  after_reset(bench);
}

/* Run for `cycles` cycles. Returns simavr's state, and ends early where the program did. */
int bench_run(bench_t *bench, uint64_t cycles) {
  avr_t *avr = bench->avr;
  avr_cycle_count_t end = avr->cycle + cycles;
  int state = avr->state;
  hold_pins(bench);
  avr_cycle_timer_cancel(avr, on_end, bench);
  avr_cycle_timer_register(avr, cycles, on_end, bench); /* sleep goes no further */
  while (avr->cycle < end) {
    avr_flashaddr_t before = avr->pc;
    state = avr_run(avr);
    if (state == cpu_Done || state == cpu_Crashed) break;
    if (avr->pc == avr->reset_pc && before != avr->reset_pc) {
      after_reset(bench);
      avr_cycle_timer_register(avr, end - avr->cycle, on_end, bench);
    }
  }
  return state;
}
