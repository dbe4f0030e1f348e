"""SolarXR, the protocol of SlimeVR servers and Monado."""
