"""Outlets for events: MQTT, webhook, XJMF, OPC UA; each in a thread of its own, fed by a bounded queue."""
