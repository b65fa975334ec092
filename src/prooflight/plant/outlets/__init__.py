"""Ways out: MQTT, webhook, XJMF, OPC UA; each in a thread of its own, behind a bounded queue."""
