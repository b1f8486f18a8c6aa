"""One class per actuator: what to send, on its own absolute time grid."""
