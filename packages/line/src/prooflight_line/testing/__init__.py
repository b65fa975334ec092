"""What tests and studies plug in where no hardware is: cameras on loopback, and a link that can be cut."""
