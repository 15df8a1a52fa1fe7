/* Where what is wired to an Arduino Mega 2560; docs/wiring.md has the same as a table.
 * Wheels: 0 rear right, 1 rear left, 2 front right, 3 front left.
 */
#ifndef PINS_H
#define PINS_H

#include <avr/io.h>

#define WHEELS 4

/* Encoders, channels A and B: wheel 0 on D53 and D52, 1 on D51 and D50, 2 on D10 and D11, 3 on D12
 * and D13 (PB0 to PB7). */
#define ENCODER_PIN PINB
#define ENCODER_PORT PORTB
#define ENCODER_DDR DDRB

/* Motors: PWM of 20 kHz on D6, D7, D8 (OC4A to OC4C) and D5 (OC3A); direction on D22 to D25. */
#define PWM_TOP 799
#define DIRECTION_PORT PORTA

/* Tool: bit k on D37 - k (PC0 to PC7). */
#define TOOL_PORT PORTC

/* Emergency stop on D49 (PL0) and bumper on D48 (PL1): contacts that are closed to ground while
 * all is well, so that a broken wire stops the robot. */
#define INPUT_PIN PINL
#define INPUT_PORT PORTL
#define ESTOP_BIT 0
#define BUMPER_BIT 1

/* IMU on D20 and D21 (PD1 data, PD0 clock). */
#define SDA_BIT 1
#define SCL_BIT 0

/* A0: battery behind 10:1 (100 k over 10 k); A1 to A4: motor currents, 2.5 V and 0.1 V/A. */
#define BATTERY_DIVIDER 11
#define ADC_MV 5000L
#define CURRENT_ZERO_MV 2500
#define CURRENT_MV_PER_A 100

/* The lamp on D47 (PL2) burns while the wheels may turn. */
#define LAMP_PORT PORTL
#define LAMP_BIT 2

#endif
