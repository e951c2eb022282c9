"""The studio: presses shapes and translates images in a browser.

press_state, session and translators are independent of the browser; page combines what one client
sees, from the folders controls (inputs) and view (outputs). transport connects clients.
"""
