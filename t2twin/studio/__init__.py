"""The studio: presses shapes and translates images in a browser.

press_state, session and translators are independent of the browser; page combines what one client
sees: controls and files (inputs), cards and scene (outputs). access decides who may connect.
"""
