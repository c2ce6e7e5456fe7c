"""Thin rclpy nodes around the model: parameters and topics in, parameters and topics out."""
