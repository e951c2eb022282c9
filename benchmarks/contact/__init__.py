"""Accuracy of contact: the references and what is compared with them."""
