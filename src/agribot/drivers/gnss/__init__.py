"""Receivers and their corrections: NMEA, UBX, SBF, Unicore, gpsd, RTCM, NTRIP."""
