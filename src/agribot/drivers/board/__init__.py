"""Motor boards: our protocol, ODrive, VESC, rosserial, over lines and CAN."""
