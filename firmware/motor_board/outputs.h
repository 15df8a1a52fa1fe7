/* Motors and tool: what switches them off does so from an interrupt, too. */
#ifndef OUTPUTS_H
#define OUTPUTS_H

#include <stdint.h>

#define FULL_DUTY 32767

void begin_outputs(void);

/* Give a motor a share of full duty, -FULL_DUTY to FULL_DUTY. Call with interrupts off. */
void set_duty(uint8_t wheel, int16_t duty);
void set_tool(uint8_t bits);
uint8_t get_tool(void);

/* Switch all motors and the tool off. */
void switch_off(void);

#endif
